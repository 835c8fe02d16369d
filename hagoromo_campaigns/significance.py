"""Significance: where a difference is more than its error, at a stated rate of false discoveries.

Enters: differences (h, w, k) and their variances. Leaves: where they are significant.

Each place is tested at several widths: the mean under a Gaussian, weighted by the inverse variance, over the error that
it has if pixels err independently. Neighbours do not, and stated errors may be too small: over all pixels the robust
spread of that ratio says how much larger its error is, and errors are widened by it, never narrowed. Most of the
surface must so be unchanged. A place counts at one width only if its mean at the next smaller one is at least half as
large: else its neighbours alone make it differ. For the same reason places that are found at one width are left out of
the means of others at wider ones, so that a deep flake is no wider than it is. χ² of the k differences then gives p,
the smallest over the widths times their number, and the rate of false discoveries is that of Benjamini and Hochberg
1995, which neighbours that err alike do not raise (Benjamini and Yekutieli 2001). Efron 2004, "Large-scale simultaneous
hypothesis testing: the choice of a null hypothesis".
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, label
from scipy.stats import chi2

from hagoromo.least_squares.loss import ROBUST_SCALE

Array = NDArray[np.float64]
WIDTHS = (0.0, 1.5, 3.0)  # px, of the Gaussians
LEAST_EIGENVALUE = 0.05  # of the correlation of the differences: none is known better than a fifth of its error
LEAST_SHARE = 1e-6  # of the median variance, that each has
HALF = 0.5  # of the mean at a width: what that at the next smaller one must be
FEWEST_PIXELS = 3  # of a region


@dataclass(frozen=True, eq=False)
class Significance:
    """p: (h, w), NaN where nothing is compared. found: (h, w) significant. threshold: largest p that is.

    widening: how much larger than stated the errors are, at each of WIDTHS, the largest of the k differences; 1: as
    stated.
    """

    p: Array
    found: NDArray[np.bool_]
    threshold: float
    widening: tuple[float, ...]


def significant(difference: Array, variance: Array, rate: float, widths: tuple[float, ...] = WIDTHS) -> Significance:
    """Where `difference` (h, w, k) of `variance` (h, w, k) is significant; NaN: not compared.

    rate: largest share of false ones among the places that are found, expected.
    """
    compared = np.asarray(np.isfinite(difference).all(axis=2) & np.isfinite(variance).all(axis=2))
    if not compared.any():
        return Significance(np.full(compared.shape, np.nan), compared, 0.0, (1.0,) * len(widths))
    smallest, widening, inner = np.full(compared.shape, np.inf), [], None
    explained = np.zeros(compared.shape, bool)
    for width in widths:
        mean, error = averaged(difference, variance, compared, width)
        if explained.any() and not explained[compared].all():
            rest = averaged(difference, variance, compared & ~explained, width)
            mean, error = (np.where(explained[..., None], *pair) for pair in zip((mean, error), rest, strict=True))
        p, wider = p_values(mean / error, compared)
        own = (
            True if inner is None else (inner * mean / error**2).sum(axis=2) >= HALF * ((mean / error) ** 2).sum(axis=2)
        )
        p, inner = np.where(own, p, 1.0), mean
        smallest = np.minimum(smallest, p)
        widening.append(wider)
        explained |= p <= false_discovery_threshold(p[compared], rate / len(widths))
    p = np.where(compared, np.minimum(smallest * len(widths), 1.0), np.nan)
    threshold = false_discovery_threshold(p[compared], rate)
    found = without_small(np.nan_to_num(p, nan=1.0) <= threshold)
    return Significance(p, found, threshold, tuple(widening))


def p_values(ratio: Array, compared: NDArray[np.bool_]) -> tuple[Array, float]:
    """p (h, w) of differences over their errors, `ratio` (h, w, k), and by how much errors were widened."""
    z = ratio[compared]
    spread = np.maximum(ROBUST_SCALE * np.median(np.abs(z - np.median(z, axis=0)), axis=0), 1.0)
    z = z / spread
    sign = np.sign(z - np.median(z, axis=0))
    correlation = np.sin(0.5 * np.pi * (sign.T @ sign) / len(z))  # Blomqvist's, which few outliers do not move
    np.fill_diagonal(correlation, 1.0)
    sizes, axes = np.linalg.eigh(correlation)
    squares = ((z @ axes) ** 2 / np.maximum(sizes, LEAST_EIGENVALUE)).sum(axis=1)
    k = z.shape[1]
    wider = max(float(np.median(squares)) / chi2.ppf(0.5, k), 1.0)
    p = np.ones(compared.shape)
    p[compared] = chi2.sf(squares / wider, k)
    return p, float(spread.max() * np.sqrt(wider))


def averaged(difference: Array, variance: Array, compared: NDArray[np.bool_], width: float) -> tuple[Array, Array]:
    """(h, w, k) means over a Gaussian of `width` [px], and the errors that independent pixels would give them.

    0 and 1 where nothing is compared.
    """
    inside = compared[..., None]
    variance = np.maximum(variance, LEAST_SHARE * np.median(variance[compared], axis=0))  # none is without error
    weight = np.where(inside, 1.0 / np.where(inside, variance, 1.0), 0.0)
    value = np.where(inside, difference, 0.0)
    if width <= 0.0:
        return value, np.where(inside, np.sqrt(np.where(inside, variance, 1.0)), 1.0)
    total = gaussian_filter(weight * value, (width, width, 0), mode="constant")
    norm = np.where(inside, gaussian_filter(weight, (width, width, 0), mode="constant"), 1.0)
    narrow = width / np.sqrt(2.0)  # the square of a Gaussian is one, times 1/(4 π width²)
    of_square = gaussian_filter(weight, (narrow, narrow, 0), mode="constant") / (4.0 * np.pi * width**2)
    return np.where(inside, total / norm, 0.0), np.where(inside, np.sqrt(np.where(inside, of_square, 1.0)) / norm, 1.0)


def false_discovery_threshold(p: Array, rate: float) -> float:
    """The largest p of those that Benjamini and Hochberg accept at `rate`; −1 where there is none.

    >>> false_discovery_threshold(np.array([0.001, 0.02, 0.5, 0.9]), 0.05)
    0.02
    """
    ordered = np.sort(p)
    passed = ordered <= rate * np.arange(1, len(ordered) + 1) / len(ordered)
    return float(ordered[np.flatnonzero(passed)[-1]]) if passed.any() else -1.0


def parts(found: NDArray[np.bool_]) -> tuple[NDArray[np.intp], int]:
    """Numbers (h, w) of the connected parts of `found`, from 1, 0 beside them, and how many there are."""
    numbered: Any = label(found, structure=np.ones((3, 3)))
    return numbered


def without_small(found: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """`found` without connected parts of fewer than FEWEST_PIXELS."""
    numbers, _ = parts(found)
    sizes = np.bincount(numbers.ravel())
    return found & (sizes[numbers] >= FEWEST_PIXELS)
