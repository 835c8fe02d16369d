"""Contact: which points of cloth may touch others of it, so that folds do not pass through each other."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hagoromo.matter.drape.sheet import Sheet

NEIGHBOURS = 2  # rows or columns: points so near on the cloth are kept apart by its stiffness
BETWEEN = 1 << 20  # rows from one sheet to the next: no neighbours
MOST = 6  # touching points that one point heeds, the nearest first


class Contacts:
    """Points of several sheets, numbered through; apart: (n) bool, points that touch their own sheet only.

    narrow: (n) how near columns are at rest, of the widest row's.
    """

    def __init__(self, sheets: Sequence[Sheet], apart: NDArray[np.bool_], narrow: NDArray[np.floating]) -> None:
        shapes = [sheet.points.shape[:2] for sheet in sheets]
        sizes = [rows * columns for rows, columns in shapes]
        self.sheet, self.apart = np.repeat(np.arange(len(sheets)), sizes), apart
        places = [np.indices(shape, np.int32).reshape(2, -1).T for shape in shapes]
        for number, place in enumerate(places):
            place[:, 0] += number * BETWEEN
        self.place = np.concatenate(places)
        columns = [shape[1] if sheet.around else BETWEEN for shape, sheet in zip(shapes, sheets, strict=True)]
        self.narrow = narrow.astype(np.float32)
        self.columns = np.repeat(np.array(columns, np.int32), sizes)

    def candidates(self, points: NDArray[np.floating], reach: float) -> NDArray[np.uint32]:
        """For every point up to MOST others within `reach` that it may touch, itself where are fewer: (MOST, n)."""
        from scipy.spatial import KDTree

        first, second = KDTree(points).query_pairs(reach, output_type="ndarray").T
        far = np.abs(self.place[first] - self.place[second])
        far[:, 1] = np.minimum(far[:, 1], self.columns[first] - far[:, 1])
        keep = (far[:, 0] > NEIGHBOURS) | (far[:, 1] * self.narrow[first] > NEIGHBOURS)
        first, second = first[keep], second[keep]
        keep = (self.sheet[first] == self.sheet[second]) | ~(self.apart[first] | self.apart[second])
        first, second = first[keep], second[keep]
        one, other = np.concatenate([first, second]), np.concatenate([second, first])
        order = np.lexsort((other, np.linalg.norm(points[one] - points[other], axis=1), one))
        one, other = one[order], other[order]
        starts = np.searchsorted(one, np.arange(len(points)))
        rank = np.arange(len(one)) - starts[one]
        table = np.tile(np.arange(len(points), dtype=np.uint32), (MOST, 1))
        table[rank[rank < MOST], one[rank < MOST]] = other[rank < MOST]
        return table
