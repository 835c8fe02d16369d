"""BasisCurves of USD, read by usd-core in a process of its own → polylines in the file's units, at their places."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.files.apart import read_apart
from hagoromo.files.reading import library, reading
from hagoromo_formats.curves.control_points import evaluated, joined
from hagoromo_formats.curves.polylines import Polylines, of_arrays
from hagoromo_formats.scenes.usd_stage import open_stage, shown, unpacked, usd_file


def usd_lines(path: Path) -> Polylines:
    """Curves of a USD file; `InputError` where it is damaged or usd-core is not installed."""
    with unpacked(path) as file:
        return of_arrays(read_apart(lines_by_usd, usd_file(file), "USD"))


def lines_by_usd(path: Path) -> Mapping[str, NDArray[Any]]:
    """In the other process: points, first, diameter (empty where a curve states none)."""
    geometry, parts = library("pxr.UsdGeom"), list[NDArray[np.float64]]()
    with reading(path, "USD"):
        stage = open_stage(path)
        cache = geometry.XformCache()
        for prim in shown(stage):
            if prim.IsA(geometry.BasisCurves):
                matrix = np.array(cache.GetLocalToWorldTransform(prim))
                parts += _lines_of(geometry.BasisCurves(prim), matrix, str(path))
    return joined(parts)


def _lines_of(curves: Any, matrix: NDArray[np.float64], where: str) -> list[NDArray[np.float64]]:
    """Points and diameter of each curve at its place; rows are vectors in USD."""
    points = np.array(curves.GetPointsAttr().Get() or (), np.float64).reshape(-1, 3)
    counts = np.array(curves.GetCurveVertexCountsAttr().Get() or (), np.int64)
    wide = np.array(curves.GetWidthsAttr().Get() or (), np.float64) * abs(np.linalg.det(matrix[:3, :3])) ** (1.0 / 3.0)
    basis = "linear" if curves.GetTypeAttr().Get() == "linear" else str(curves.GetBasisAttr().Get())
    is_pinned = str(curves.GetWrapAttr().Get()) == "pinned"
    return evaluated(points @ matrix[:3, :3] + matrix[3, :3], counts, wide, basis, is_pinned, where)
