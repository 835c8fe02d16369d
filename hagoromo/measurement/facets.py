"""Facets of a fit: the density of Student-t facets and its slopes by ln γ and by the tail 1/ν, in double precision.

    D(φ; γ, ν) = (1 + (2^{1/ν} − 1) φ²/γ²)^{−ν},   D → exp(−ln2 φ²/γ²) (eq. 4) for ν → ∞

Fits use the tail 1/ν: it is 0 for Gaussian facets, and D is smooth there.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.reflectance.facets import LN2
from hagoromo.reflectance.parameters import ROWS

Array = NDArray[np.float64]

TAIL_RANGE = ROWS["nu"].fit.bounds  # admissible 1/ν
SMALL_TAIL = 1e-4  # below, slopes by the tail are taken from the series in it
FARTHEST = 1e3  # (φ/γ)² beyond which facets of a small tail have no density


class FacetDensity(NamedTuple):
    """D and its slopes by ln γ and by the tail, all of one shape."""

    value: Array
    by_log_gamma: Array
    by_tail: Array


def facet_density(angle2: Array, log_gamma: Array, tail: Array, with_tail: bool = True) -> FacetDensity:
    """The density at squared angles φ² [rad²], for ln γ [rad] and tails 1/ν that broadcast with them.

    with_tail: whether the slope by the tail is needed; else it is 0.
    """
    u = angle2 * np.exp(-2.0 * log_gamma)
    if not np.any(tail):
        value = np.exp(-LN2 * u)
        by_tail = _slope_of_small(u, 0.0) * value if with_tail else np.zeros(1)
        return FacetDensity(value, 2.0 * LN2 * u * value, by_tail)
    tail = np.broadcast_to(tail, u.shape)
    known = np.maximum(tail, 1e-12)
    rise = np.expm1(LN2 * known)
    beside = np.log1p(rise * u)
    value = np.exp(np.where(tail > 0.0, -beside / known, -LN2 * u))
    by_log_gamma = 2.0 * u * rise / (known * (1.0 + rise * u)) * value
    if not with_tail:
        return FacetDensity(value, by_log_gamma, np.zeros(1))
    return FacetDensity(value, by_log_gamma, log_density_by_tail(u, tail) * value)


def log_density_by_tail(u: Array, tail: Array) -> Array:
    """Slope of ln D by the tail 1/ν, at u = φ²/γ²; the two are of one shape."""
    known = np.maximum(tail, 1e-12)
    rise = np.expm1(LN2 * known)
    slope = np.log1p(rise * u) / known**2 - LN2 * (1.0 + rise) * u / (known * (1.0 + rise * u))
    return np.where(tail < SMALL_TAIL, _slope_of_small(u, tail), slope)


def _slope_of_small(u: Array, tail: Array | float) -> Array:
    """Slope of ln D by a small tail, to its second term."""
    u = np.minimum(u, FARTHEST)
    return 0.5 * LN2**2 * (u * u - u) - 2.0 * tail * LN2**3 * u * (1.0 / 6.0 - 0.5 * u + u * u / 3.0)
