"""Curves by control points, linear or cubic, → polylines."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.memory import require

PIECES = 4  # straight pieces of a cubic segment
BYTES_PER_POINT = 100.0
BASES = {  # rows: coefficients of 1, t, t², t³ on four control points; and how many points a segment goes on
    "bezier": (np.array([[1, 0, 0, 0], [-3, 3, 0, 0], [3, -6, 3, 0], [-1, 3, -3, 1]], float), 3),
    "bspline": (np.array([[1, 4, 1, 0], [-3, 0, 3, 0], [3, -6, 3, 0], [-1, 3, -3, 1]], float) / 6.0, 1),
    "catmullRom": (np.array([[0, 2, 0, 0], [-1, 0, 1, 0], [2, -5, 4, -1], [-1, 3, -3, 1]], float) / 2.0, 1),
}


def evaluated(
    points: NDArray[np.float64],
    counts: NDArray[np.int64],
    wide: NDArray[np.float64],
    basis: str,
    is_pinned: bool,
    where: str,
) -> list[NDArray[np.float64]]:
    """Points and diameter, (n, 4), of each curve; the diameter is nan where none is stated.

    points: (m, 3) control points of all. counts: how many each has. wide: diameters, one for all, for each curve or
    point. basis: linear or one of BASES; where: the file, for messages.
    """
    if (counts < 0).any() or counts.sum() > len(points):
        raise InputError(f"{where} names {counts.sum()} points of its curves and holds {len(points)}: it is damaged")
    require(BYTES_PER_POINT * PIECES * len(points), where)
    if len(wide) == len(counts) != len(points):
        wide = np.repeat(wide, counts)
    elif len(wide) == 1:
        wide = np.full(len(points), wide[0])
    elif len(wide) != len(points):
        wide = np.full(len(points), np.nan)  # of kinds of interpolation that curves of hair do not use
    if len(wide) != len(points):  # one for each curve, of fewer points than the file has
        wide = np.pad(wide, (0, len(points) - len(wide)), constant_values=np.nan)
    each = np.split(np.column_stack([points, wide])[: counts.sum()], np.cumsum(counts)[:-1])
    if basis == "linear":
        return each
    if basis not in BASES:
        raise InputError(f"{where} has curves of basis {basis}: give bezier, bspline, catmullRom or linear ones")
    return [_evaluated(line, basis, is_pinned) for line in each]


def _evaluated(line: NDArray[np.float64], basis: str, is_pinned: bool) -> NDArray[np.float64]:
    """Points of a cubic curve; a pinned one passes through its first and last control point."""
    matrix, onward = BASES[basis]
    if is_pinned and onward == 1 and len(line) >= 2:
        line = np.concatenate([2.0 * line[:1] - line[1:2], line, 2.0 * line[-1:] - line[-2:-1]])
    if len(line) < 4:
        return line
    starts = np.arange(0, len(line) - 3, onward)
    share = np.arange(PIECES) / PIECES
    powers = np.stack([share**k for k in range(4)], axis=-1) @ matrix
    control = line[starts[:, None] + np.arange(4)]
    last = np.ones(4) @ matrix @ control[-1]
    return np.concatenate([np.einsum("pc,scv->spv", powers, control).reshape(-1, line.shape[1]), last[None]])


def joined(parts: list[NDArray[np.float64]]) -> dict[str, NDArray[Any]]:
    """points, first and diameter of curves of `evaluated`, for another process; no diameter where some state none."""
    values = np.concatenate([np.zeros((0, 4)), *parts])
    wide = np.zeros(0) if np.isnan(values[:, 3]).any() else values[:, 3]
    return {"points": values[:, :3], "first": np.cumsum([0, *map(len, parts)]), "diameter": wide}
