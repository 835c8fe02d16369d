"""Curves of Alembic at their first time, read in a process of its own → polylines in the file's units, placed."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.apart import read_apart
from hagoromo.files.memory import require
from hagoromo.files.reading import library, reading
from hagoromo_formats.curves.control_points import evaluated, joined
from hagoromo_formats.curves.polylines import Polylines, of_arrays
from hagoromo_formats.meshes.mesh_abc import BYTES_PER_NUMBER, MOST_OBJECTS, placed_objects

BASES = {"kBezierBasis": "bezier", "kBsplineBasis": "bspline", "kCatmullromBasis": "catmullRom"}


def abc_lines(path: Path) -> Polylines:
    """Curves of an Alembic file; `InputError` where it is damaged or alembic3d is not installed."""
    library("alembic3d")
    return of_arrays(read_apart(lines_by_alembic, path, "Alembic"))


def lines_by_alembic(path: Path) -> Mapping[str, NDArray[Any]]:
    """In the other process: points, first, diameter (empty where a curve states none)."""
    alembic, parts, held = library("alembic3d"), list[NDArray[np.float64]](), 0
    with reading(path, "Alembic"):
        top = alembic.Abc.IArchive(str(path)).getTop()
        for count, (curves, matrix) in enumerate(placed_objects(alembic, top, (alembic.AbcGeom.ICurves,))):
            schema = curves.getSchema()
            sample, wide = schema.getValue(), schema.getWidthsParam()
            held += len(sample.getPositions())
            if count > MOST_OBJECTS:
                raise InputError(f"{path} has more than {MOST_OBJECTS} groups of curves: join them")
            require(BYTES_PER_NUMBER * held, str(path))  # many groups may share the numbers of the file
            points = np.array([tuple(p) for p in sample.getPositions()], np.float64).reshape(-1, 3)
            counts = np.array(list(sample.getCurvesNumVertices()), np.int64)
            stated = list(wide.getExpandedValue().getVals()) if wide and wide.valid() else []
            scale = abs(np.linalg.det(matrix[:3, :3])) ** (1.0 / 3.0)
            placed = points @ matrix[:3, :3] + matrix[3, :3]
            parts += evaluated(placed, counts, scale * np.array(stated, np.float64), _basis(sample), False, str(path))
    return joined(parts)


def _basis(sample: Any) -> str:
    """linear, or the name that USD has for the basis."""
    kind = sample.getType().name
    return {"kLinear": "linear", "kCubic": BASES.get(sample.getBasis().name, sample.getBasis().name)}.get(kind, kind)
