"""Trend: what differences have in common over the object, which errors of lamps and of integration also make.

A polynomial in the image, and further patterns that errors of both campaigns follow, fitted with Tukey's loss to the
differences over their errors. It is taken out of them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hagoromo.least_squares.loss import ROBUST_SCALE, TUKEY

Array = NDArray[np.float64]
REWEIGHTINGS = 20


def trend(difference: Array, variance: Array, degree: int, pattern: Array | None = None) -> tuple[Array, Array]:
    """What most of `difference` (h, w, k) follows, and the coefficients (t, k).

    x and y run from −1 to 1 over the image; the first coefficient is the median of the trend. pattern: (h, w, k)
    further term of each of the k differences, of its own size.
    """
    height, width, count = difference.shape
    y, x = np.meshgrid(np.linspace(-1.0, 1.0, height), np.linspace(-1.0, 1.0, width), indexing="ij")
    plain = np.stack([x**i * y ** (n - i) for n in range(degree + 1) for i in range(n, -1, -1)], axis=2)
    common, coefficients = np.zeros(difference.shape), []
    for k in range(count):
        terms = plain if pattern is None else np.concatenate([plain, pattern[..., k : k + 1]], axis=2)
        used = np.isfinite(difference[..., k]) & np.isfinite(variance[..., k]) & np.isfinite(terms).all(axis=2)
        found = _robust(terms[used], difference[used][:, k], np.sqrt(variance[used][:, k])) if used.any() else None
        found = np.zeros(terms.shape[2]) if found is None else found
        common[..., k] = terms @ found
        middle = float(np.median(common[..., k][used])) if used.any() else 0.0
        coefficients.append([middle, *found[1:]])
    return common, np.array(coefficients).T


def _robust(rows: Array, value: Array, error: Array) -> Array:
    """The coefficients of `rows` (n, t) that most of `value` (n,) follows, in its `error`."""
    error = np.maximum(error, 1e-3 * np.median(error) + 1e-300)
    found = np.zeros(rows.shape[1])
    found[0] = float(np.median(value))
    for _ in range(REWEIGHTINGS):
        rest = (value - rows @ found) / error
        scale = max(ROBUST_SCALE * float(np.median(np.abs(rest))), 1e-12)
        root = np.sqrt(TUKEY.weight(rest / scale)) / error
        found = np.linalg.lstsq(rows * root[:, None], value * root, rcond=None)[0]
    return np.asarray(found, np.float64)
