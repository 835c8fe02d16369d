"""Nearest: for each pixel the nearest one that is known."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def nearest_known(known: NDArray[np.bool_]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows and columns (h, w) of the nearest pixel that is `known` (h, w), of which there is one at least.

    >>> nearest_known(np.array([[False, True, False]]))[1].tolist()
    [[1, 1, 1]]
    """
    from scipy.ndimage import distance_transform_edt

    rows, columns = np.asarray(distance_transform_edt(~known, return_distances=False, return_indices=True))
    return rows, columns
