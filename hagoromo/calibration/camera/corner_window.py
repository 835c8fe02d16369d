"""Corner window: size of the window of the sub-pixel search around a chessboard corner.

The search assumes that every edge in its window passes through the corner. Other edges bias it: the sides of the next
squares and, if the outer squares are cut, the edge of the board. On simulated boards with blur and noise, the accuracy
grows with the window as long as it contains no other edges.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

INNER_SHARE, OUTER_SHARE = 1.0 / 2.0, 1.0 / 3.0  # of the distance to the next edge; outer squares may be cut in half
LEAST_HALF_SIDE_PX, LARGEST_HALF_SIDE_PX = 2, 15  # [px] larger windows gain nothing, as distorted edges are curved
SIDE_SAMPLES = 17  # points along the side of a square
# corners of the four squares around a corner, in order, as steps of rows and columns
SQUARE_CORNERS = ((-1, -1), (-1, 0), (-1, 1), (0, 1), (1, 1), (1, 0), (1, -1), (0, -1))


def corner_windows(corners: NDArray[Any]) -> NDArray[np.intp]:
    """Half sides (rows, columns) [px] of the search windows of the corners at `corners` (rows, columns, 2) [px]."""
    share = np.full(corners.shape[:2], OUTER_SHARE)
    share[1:-1, 1:-1] = INNER_SHARE
    return np.clip(share * next_edge(corners), LEAST_HALF_SIDE_PX, LARGEST_HALF_SIDE_PX).astype(np.intp)


def next_edge(corners: NDArray[Any]) -> NDArray[np.float64]:
    """(rows, columns) distance [px] to the nearest side of a square that does not pass through the corner.

    The distance is the larger of those along rows and columns, because windows are square. Squares beyond the outer
    corners are assumed as large as their neighbours.
    """
    rows, columns = corners.shape[:2]
    whole = np.pad(corners.astype(np.float64), ((1, 1), (1, 1), (0, 0)))
    whole[0, 1:-1], whole[-1, 1:-1] = 2 * corners[0] - corners[1], 2 * corners[-1] - corners[-2]
    whole[:, 0], whole[:, -1] = 2 * whole[:, 1] - whole[:, 2], 2 * whole[:, -2] - whole[:, -3]
    ring = [whole[1 + down : 1 + down + rows, 1 + right : 1 + right + columns] for down, right in SQUARE_CORNERS]
    along = np.linspace(0.0, 1.0, SIDE_SAMPLES)[:, None, None, None]
    sides = [one * (1.0 - along) + other * along for one, other in zip(ring, ring[1:] + ring[:1], strict=True)]
    return np.min([np.abs(side - corners).max(axis=-1).min(axis=0) for side in sides], axis=0)
