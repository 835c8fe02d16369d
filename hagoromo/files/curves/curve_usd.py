"""BasisCurves of USD, read by usd-core in a process of its own → polylines in the file's units, at their places."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.apart import read_apart
from hagoromo.files.curves.curve_file import Lines
from hagoromo.files.library import library
from hagoromo.files.memory import require
from hagoromo.files.reading import reading
from hagoromo.files.usd_stage import open_stage, shown, usd_file

PIECES = 4  # straight pieces of a cubic segment
BYTES_PER_POINT = 100.0
BASES = {  # rows: coefficients of 1, t, t², t³ on four control points; and how many points a segment goes on
    "bezier": (np.array([[1, 0, 0, 0], [-3, 3, 0, 0], [3, -6, 3, 0], [-1, 3, -3, 1]], float), 3),
    "bspline": (np.array([[1, 4, 1, 0], [-3, 0, 3, 0], [3, -6, 3, 0], [-1, 3, -3, 1]], float) / 6.0, 1),
    "catmullRom": (np.array([[0, 2, 0, 0], [-1, 0, 1, 0], [2, -5, 4, -1], [-1, 3, -3, 1]], float) / 2.0, 1),
}


def usd_lines(path: Path) -> Lines:
    """Curves of a USD file; `InputError` where it is damaged or usd-core is not installed."""
    arrays = read_apart(lines_by_usd, usd_file(path), "USD")
    wide = arrays["diameter"]
    return Lines(arrays["points"], arrays["first"], wide if len(wide) else None)


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
    values = np.concatenate([np.zeros((0, 4)), *parts])
    wide = np.zeros(0) if np.isnan(values[:, 3]).any() else values[:, 3]
    return {"points": values[:, :3], "first": np.cumsum([0, *map(len, parts)]), "diameter": wide}


def _lines_of(curves: Any, matrix: NDArray[np.float64], where: str) -> list[NDArray[np.float64]]:
    """Points and diameter, (n, 4), of each curve; the diameter is nan where none is stated."""
    points = np.array(curves.GetPointsAttr().Get() or (), np.float64).reshape(-1, 3)
    counts = np.array(curves.GetCurveVertexCountsAttr().Get() or (), np.int64)
    if (counts < 0).any() or counts.sum() > len(points):
        raise InputError(f"{where} names {counts.sum()} points of its curves and holds {len(points)}: it is damaged")
    require(BYTES_PER_POINT * PIECES * len(points), where)
    # rows are vectors in USD
    placed = points @ matrix[:3, :3] + matrix[3, :3]
    wide = np.array(curves.GetWidthsAttr().Get() or (), np.float64)
    scale = abs(np.linalg.det(matrix[:3, :3])) ** (1.0 / 3.0)
    if len(wide) == len(counts) != len(points):
        wide = np.repeat(wide, counts)
    elif len(wide) == 1:
        wide = np.full(len(points), wide[0])
    elif len(wide) != len(points):
        wide = np.full(len(points), np.nan)  # of kinds of interpolation that curves of hair do not use
    values = np.column_stack([placed, wide * scale])
    each = np.split(values[: counts.sum()], np.cumsum(counts)[:-1])
    is_cubic, basis = curves.GetTypeAttr().Get() != "linear", str(curves.GetBasisAttr().Get())
    if not is_cubic:
        return each
    if basis not in BASES:
        raise InputError(f"{where} has curves of basis {basis}: give bezier, bspline, catmullRom or linear ones")
    return [_evaluated(line, basis, str(curves.GetWrapAttr().Get())) for line in each]


def _evaluated(line: NDArray[np.float64], basis: str, wrap: str) -> NDArray[np.float64]:
    """Points of a cubic curve; a pinned one passes through its first and last control point."""
    matrix, onward = BASES[basis]
    if wrap == "pinned" and onward == 1 and len(line) >= 2:
        line = np.concatenate([2.0 * line[:1] - line[1:2], line, 2.0 * line[-1:] - line[-2:-1]])
    if len(line) < 4:
        return line
    starts = np.arange(0, len(line) - 3, onward)
    share = np.arange(PIECES) / PIECES
    powers = np.stack([share**k for k in range(4)], axis=-1) @ matrix
    control = line[starts[:, None] + np.arange(4)]
    last = np.ones(4) @ matrix @ control[-1]
    return np.concatenate([np.einsum("pc,scv->spv", powers, control).reshape(-1, line.shape[1]), last[None]])
