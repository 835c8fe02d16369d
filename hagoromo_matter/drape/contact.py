"""Contact: the pairs of points of cloth that may touch, so that folds do not pass through each other."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hagoromo_matter.drape.sheet import Sheet

NEIGHBOUR_ROWS = 2  # [rows or columns] closer points are held apart by the stiffness of the cloth
ROWS_BETWEEN_SHEETS = 1 << 20  # rows between two sheets, so that they have no neighbours in common
LARGEST_CONTACTS = 6  # contacts of one point that are used, the nearest first


class Contacts:
    """Points of several sheets with consecutive numbers; apart: (n) bool, points that touch only their own sheet.

    narrow: (n) distance of columns at rest, relative to the widest row.
    """

    def __init__(self, sheets: Sequence[Sheet], apart: NDArray[np.bool_], narrow: NDArray[np.floating]) -> None:
        shapes = [sheet.points.shape[:2] for sheet in sheets]
        sizes = [rows * columns for rows, columns in shapes]
        self.sheet, self.apart = np.repeat(np.arange(len(sheets)), sizes), apart
        places = [np.indices(shape, np.int32).reshape(2, -1) for shape in shapes]
        self.row = np.concatenate([place[0] + number * ROWS_BETWEEN_SHEETS for number, place in enumerate(places)])
        self.column = np.concatenate([place[1] for place in places])
        columns = [
            shape[1] if sheet.around else ROWS_BETWEEN_SHEETS for shape, sheet in zip(shapes, sheets, strict=True)
        ]
        self.narrow = narrow.astype(np.float32)
        self.columns = np.repeat(np.array(columns, np.int32), sizes)

    def candidates(self, points: NDArray[np.floating], reach: float) -> NDArray[np.uint32]:
        """(LARGEST_CONTACTS, n) points within `reach` that each point may touch; its own number fills the rest."""
        from scipy.spatial import KDTree

        # a tree that is used once need not be balanced
        tree = KDTree(points, balanced_tree=False, compact_nodes=False)
        first, second = tree.query_pairs(reach, output_type="ndarray").T
        near = np.flatnonzero(np.abs(self.row[first] - self.row[second]) <= NEIGHBOUR_ROWS)
        one = first[near]
        across = np.abs(self.column[one] - self.column[second[near]])
        across = np.minimum(across, self.columns[one] - across)
        keep = np.ones(len(first), bool)
        keep[near] = across * self.narrow[one] > NEIGHBOUR_ROWS
        first, second = first[keep], second[keep]
        keep = (self.sheet[first] == self.sheet[second]) | ~(self.apart[first] | self.apart[second])
        first, second = first[keep], second[keep]
        one, other = np.concatenate([first, second]), np.concatenate([second, first])
        order = np.lexsort((other, np.linalg.norm(points[one] - points[other], axis=1), one))
        one, other = one[order], other[order]
        starts = np.searchsorted(one, np.arange(len(points)))
        rank = np.arange(len(one)) - starts[one]
        table = np.tile(np.arange(len(points), dtype=np.uint32), (LARGEST_CONTACTS, 1))
        table[rank[rank < LARGEST_CONTACTS], one[rank < LARGEST_CONTACTS]] = other[rank < LARGEST_CONTACTS]
        return table
