"""Curve process: the Gaussian process of z in R = κ log(1 + exp(z/κ)), from a few figures of published cameras.

The figures stand in `published_curves`, which `python -m studies.response_prior` writes with the help of this file.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

NODES = np.arange(380.0, 781.0, 10.0)  # [nm]
# Chosen on the 28 measured cameras of camspec; it serves rawtoaces' 11 cameras as well.
KNEE = 0.3  # κ: below it R is an exponential of z, above it R ≈ z
JITTER = 1e-6  # relative addition to the diagonal that keeps the kernel invertible in double precision
Array = NDArray[np.float64]


class PublishedCurve(NamedTuple):
    """mean: z at `NODES`. share: of the components. smooth, rough: standard deviations of z, correlated over `length`
    [nm] and independent per wavelength, each where R is near 0 and where it is large.
    """

    mean: tuple[float, ...]
    share: float
    smooth: tuple[float, ...]
    rough: tuple[float, ...]
    length: float


def positive(z: Array) -> Array:
    """κ log(1 + exp(z/κ))."""
    return KNEE * np.logaddexp(0.0, z / KNEE)


def slope(z: Array) -> Array:
    """d positive/dz = 1/(1 + exp(−z/κ))."""
    return 0.5 + 0.5 * np.tanh(0.5 * z / KNEE)


def published_process(
    wavelengths: Array, mean: Array, components: Array, figures: PublishedCurve
) -> tuple[Array, Array]:
    """Mean (n,) and covariance (n, n) of z at `wavelengths` [nm] from those at `NODES`.

    Σ share · component componentᵀ + a(λ) a(λ') Matérn + r(λ)² δ: the standard deviations a (smooth) and r (rough) pass
    from one value where R is near 0 to another where it is large.
    """
    at = np.interp(wavelengths, NODES, mean)
    parts = np.array([np.interp(wavelengths, NODES, part) for part in components])
    bright = slope(at)
    smooth, rough = (
        np.sqrt(dark**2 * (1.0 - bright) + light**2 * bright) for dark, light in (figures.smooth, figures.rough)
    )
    kernel = figures.share * parts.T @ parts + smooth[:, None] * matern(wavelengths, figures.length) * smooth
    return at, kernel + np.diag(rough**2) + JITTER * np.eye(len(wavelengths))


def matern(wavelengths: Array, length: float) -> Array:
    """Matérn 3/2 correlation (n, n)."""
    apart = np.sqrt(3.0) * np.abs(wavelengths[:, None] - wavelengths) / length
    return (1.0 + apart) * np.exp(-apart)
