"""Squares: means over squares of pixels."""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray


def square_means(maps: NDArray, step: int) -> NDArray[Any]:
    """Means of (h, w, …) over squares of `step` pixels, NaN where one is; rows and columns that fill none are left out.

    >>> import numpy as np
    >>> square_means(np.array([[1.0, 3.0, 9.0], [5.0, 7.0, 9.0]]), 2).tolist()
    [[4.0]]
    """
    height, width = (size // step * step for size in maps.shape[:2])
    parts = maps[:height, :width].reshape(height // step, step, width // step, step, *maps.shape[2:])
    return parts.mean(axis=(1, 3))
