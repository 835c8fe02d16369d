"""The most likely spectra within bounds, of many pixels at once, each a Gaussian of its own.

min (x − m)ᵀ C⁻¹ (x − m) for 0 ≤ x ≤ upper: x = m − C λ, λ other than 0 at active bounds only. These are found
by exchanging all that are wrong at once: Portugal, Júdice and Vicente 1994, "A comparison of block pivoting and
interior-point algorithms for linear least squares problems with nonnegative variables".
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

MOST_EXCHANGES = 40
NEARLY = 1e-9  # of the largest standard deviation: a bound that is missed by less is kept
Array = NDArray[Any]


def within_bounds(means: Array, covariances: Array, upper: ArrayLike) -> Array:
    """(pixels, n) most likely spectra in 0…`upper` under means (pixels, n) and covariances (pixels, n, n).

    upper: a number, or one per pixel (pixels, 1).

    Pixels whose active bounds are not settled after `MOST_EXCHANGES` are cut off at the bounds.
    """
    result, top = means.copy(), np.broadcast_to(np.asarray(upper, np.float64), means.shape)
    side = np.zeros(means.shape, np.int8)  # −1 at 0, 1 at the upper bound
    slack = NEARLY * np.sqrt(np.einsum("knn->kn", covariances)).max(axis=1, keepdims=True)
    open_pixels = np.arange(len(means))
    for _ in range(MOST_EXCHANGES):
        fixed = side[open_pixels] != 0
        bound = np.where(side[open_pixels] > 0, top[open_pixels], 0.0)
        both = fixed[:, :, None] & fixed[:, None, :]
        system = np.where(both, covariances[open_pixels], np.eye(means.shape[1]))
        push = np.linalg.solve(system, np.where(fixed, means[open_pixels] - bound, 0.0)[..., None])[..., 0]
        values = means[open_pixels] - np.einsum("kab,kb->ka", covariances[open_pixels], push)
        result[open_pixels] = values
        wrong_side = push * side[open_pixels] < 0.0
        low = ~fixed & (values < -slack[open_pixels])
        high = ~fixed & (values > top[open_pixels] + slack[open_pixels])
        side[open_pixels] = np.where(wrong_side, 0, np.where(low, -1, np.where(high, 1, side[open_pixels])))
        open_pixels = open_pixels[(wrong_side | low | high).any(axis=1)]
        if not len(open_pixels):
            break
    return np.clip(result, 0.0, top)
