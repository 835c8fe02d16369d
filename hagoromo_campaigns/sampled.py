"""Sampled: maps between their pixels, and maps that are smoothed where they are known."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, map_coordinates

Array = NDArray[np.float64]


def sampled(maps: Array, at: Array, order: int = 1) -> Array:
    """`maps` (h, w[, k]) at image points `at` (…, 2) (x, y) [px]: NaN beside the image and next to unknown pixels.

    order: 1 linear, 3 cubic splines, which the unknown pixels of `filled` maps must not reach.
    """
    place = [np.nan_to_num(at[..., 1], nan=-9.0) - 0.5, np.nan_to_num(at[..., 0], nan=-9.0) - 0.5]
    layers = maps[..., None] if maps.ndim == 2 else maps
    each = [
        map_coordinates(layers[..., k], place, order=order, mode="constant", cval=np.nan)
        for k in range(layers.shape[2])
    ]
    return each[0] if maps.ndim == 2 else np.stack(each, axis=-1)


def smoothed(maps: Array, width: float) -> Array:
    """`maps` (h, w, k) under a Gaussian of `width` [px], of their known pixels alone; NaN where they are unknown."""
    if width <= 0.0:
        return maps
    known = np.isfinite(maps)
    total = gaussian_filter(np.where(known, maps, 0.0), (width, width, 0))
    weight = gaussian_filter(known.astype(np.float64), (width, width, 0))
    return np.where(known, total / np.maximum(weight, 1e-12), np.nan)
