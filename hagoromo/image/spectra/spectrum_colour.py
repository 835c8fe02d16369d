"""Colour of a reflectance spectrum under a lamp, CIELAB relative to that lamp's white, and ΔE00 with its interval."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.response import Response, camera_white
from hagoromo.light.spectrum import Spectrum
from hagoromo.reflectance.spectra.spectrum_estimate import SpectrumEstimate, reading_matrix

DRAWS = 2000  # of a posterior, for intervals of ΔE00
ELLIPSE_95 = 5.991  # χ² of two degrees of freedom at 95 %
Array = NDArray[Any]


@dataclass(frozen=True, eq=False)
class SpectrumColour:
    """CIELAB (3,) of a spectrum under a lamp, and its covariance (3, 3) to first order.

    ellipse: semi-axes of the 95 % ellipse in the plane of a* and b*, and the angle [°] of the longer one from a*.
    delta_e_95: ΔE00 between the estimate and the truth, which is below it with 95 % probability.
    """

    lab: Array
    covariance: Array
    delta_e_95: float

    @property
    def ellipse(self) -> tuple[float, float, float]:
        """Longer and shorter semi-axis, and angle [°]."""
        squares, axes = np.linalg.eigh(self.covariance[1:, 1:])
        longer, shorter = np.sqrt(ELLIPSE_95 * np.maximum(squares[::-1], 0.0))
        return float(longer), float(shorter), float(np.degrees(np.arctan2(axes[1, 1], axes[0, 1])) % 180.0)


def lab(spectra: Array, lamp: Spectrum) -> Array:
    """CIELAB (CIE 15:2004) of spectra (..., wavelengths) of reflectance under `lamp`; its white has L* = 100."""
    ratio = np.maximum(xyz(spectra, lamp), 0.0) / _observer(lamp)[1]
    curve = np.where(ratio > (6 / 29) ** 3, np.cbrt(ratio), ratio * (29 / 6) ** 2 / 3 + 4 / 29)
    x, y, z = np.moveaxis(curve, -1, 0)
    return np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], axis=-1)


def xyz(spectra: Array, lamp: Spectrum) -> Array:
    """XYZ (..., 3) of spectra (..., wavelengths) of reflectance under `lamp`; a perfect white has Y = 1."""
    return np.asarray(spectra) @ _observer(lamp)[0].T


def spectrum_colour(estimate: SpectrumEstimate, lamp: Spectrum) -> SpectrumColour:
    """The colour of `estimate` under `lamp`, with its uncertainty; draws have a fixed seed."""
    middle, draws = lab(estimate.values, lamp), lab(_draws(estimate, 0), lamp)
    return SpectrumColour(middle, np.cov(draws.T), float(np.percentile(_delta_e(draws, middle), 95.0)))


def spectrum_difference(
    one: SpectrumEstimate, other: SpectrumEstimate | Spectrum, lamp: Spectrum
) -> tuple[float, float, float]:
    """ΔE00 of two spectra under `lamp`, and its 95 % interval; errors of the two are taken as independent."""
    second = other.values if isinstance(other, SpectrumEstimate) else other.held(360.0, 830.0).at(one.wavelengths)
    draws = _draws(other, 1) if isinstance(other, SpectrumEstimate) else np.broadcast_to(second, (DRAWS, len(second)))
    off = _delta_e(lab(_draws(one, 0), lamp), lab(draws, lamp))
    low, high = np.percentile(off, [2.5, 97.5])
    return float(_delta_e(lab(one.values, lamp), lab(second, lamp))), float(low), float(high)


def _draws(estimate: SpectrumEstimate, seed: int) -> Array:
    values, vectors = np.linalg.eigh(estimate.covariance)
    random = np.random.default_rng(seed).standard_normal((DRAWS, len(values)))
    return np.maximum(estimate.values + (random * np.sqrt(np.maximum(values, 0.0))) @ vectors.T, 0.0)


def _delta_e(one: Array, other: Array) -> Array:
    import colour

    return np.asarray(colour.delta_E(one, other, method="CIE 2000"), np.float64)


@lru_cache(maxsize=16)
def _observer(lamp: Spectrum) -> tuple[Array, Array]:
    """XYZ of a reflectance (3, wavelengths), relative to Y of white, and of white (3,)."""
    observer = Response.load("cie1931")
    reads = camera_white(lamp, observer)
    white = reads / reads[1]
    return reading_matrix(lamp, observer) * white[:, None], white
