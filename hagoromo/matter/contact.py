"""Contact: which points of cloth may touch others of it, so that folds do not pass through each other."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hagoromo.matter.sheet import Sheet

NEIGHBOURS = 2  # rows or columns: points so near on the cloth are kept apart by its stiffness
MOST = 6  # touching points that one point heeds, the nearest first


class Contacts:
    """Points of several sheets, numbered through; apart: (n) bool, points that touch their own sheet only."""

    def __init__(self, sheets: Sequence[Sheet], apart: NDArray[np.bool_]) -> None:
        shapes = [sheet.points.shape[:2] for sheet in sheets]
        places = [np.indices(shape).reshape(2, -1) for shape in shapes]
        self.row, self.column = np.concatenate(places, axis=1)
        sizes = [rows * columns for rows, columns in shapes]
        self.sheet = np.repeat(np.arange(len(sheets)), sizes)
        columns = [shape[1] if sheet.around else 1 << 30 for shape, sheet in zip(shapes, sheets, strict=True)]
        self.columns, self.apart = np.repeat(columns, sizes), apart

    def found(self, points: NDArray[np.floating], reach: float) -> NDArray[np.uint32]:
        """For every point up to MOST others within `reach` that it may touch, itself where are fewer: (MOST, n)."""
        from scipy.spatial import KDTree

        first, second = KDTree(points).query_pairs(reach, output_type="ndarray").T
        same = self.sheet[first] == self.sheet[second]
        aside = np.abs(self.column[first] - self.column[second])
        aside = np.minimum(aside, self.columns[first] - aside)
        near = same & (aside <= NEIGHBOURS) & (np.abs(self.row[first] - self.row[second]) <= NEIGHBOURS)
        keep = ~near & (same | ~(self.apart[first] | self.apart[second]))
        first, second = first[keep], second[keep]
        one, other = np.concatenate([first, second]), np.concatenate([second, first])
        order = np.lexsort((other, np.linalg.norm(points[one] - points[other], axis=1), one))
        one, other = one[order], other[order]
        starts = np.searchsorted(one, np.arange(len(points)))
        rank = np.arange(len(one)) - starts[one]
        table = np.tile(np.arange(len(points), dtype=np.uint32), (MOST, 1))
        table[rank[rank < MOST], one[rank < MOST]] = other[rank < MOST]
        return table
