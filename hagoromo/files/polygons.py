"""Polygons → triangles."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def fans(counts: NDArray[np.int64], corners: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Triangles (m, 3) around the first corner of each polygon, and the polygon of each (m).

    counts: how many corners each polygon has; corners: those of all, one after the other. `ValueError` where the two
    do not fit.
    """
    if counts.size and (counts.min() < 0 or counts.sum() != corners.size):
        raise ValueError("its polygons have other corners than they state")
    parts = np.maximum(counts - 2, 0)
    polygon = np.repeat(np.arange(len(counts)), parts)
    first = (np.cumsum(counts) - counts)[polygon]
    step = np.arange(len(polygon)) - (np.cumsum(parts) - parts)[polygon]
    return np.stack([corners[first], corners[first + step + 1], corners[first + step + 2]], axis=1), polygon
