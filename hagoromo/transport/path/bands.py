"""Bands: the wavelengths at which light of higher orders is kept, chosen from a scene's spectra with their error.

A path multiplies one colour by another, so what it brings is no sum over the palette. Extinction is grey, so all
wavelengths share one path: it carries its transfer at a few wavelengths, and in between it is linear. The hat functions
about these wavelengths are further colours of a picture: it is exposed through any camera and lamp as before.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hagoromo.light.spectrum import Spectrum

COUNTS = (3, 5, 7, 9, 11, 13, 16, 21, 31)  # of bands, from which the fewest are taken
RANGE = (400.0, 700.0)  # [nm], that of cameras; beyond, the transfer is that at its ends
WIDE = (360.0, 830.0)  # [nm], that of the eye
TOLERANCE = 0.003  # of the light of a camera's channel, over all its light
ORDERS = (2, 3, 5)  # powers of a colour whose error is looked at
STEP = 1.0  # [nm] at which it is looked at


@dataclass(frozen=True)
class Bands:
    """wavelengths: (n,) [nm]. error: largest of a colour's power between them, as a share of white's light."""

    wavelengths: NDArray[np.float64]
    error: float

    @property
    def count(self) -> int:
        """Number of bands."""
        return len(self.wavelengths)

    @property
    def spectra(self) -> tuple[Spectrum, ...]:
        """The hat function about each wavelength; the first and the last go on as 1."""
        knots = self.wavelengths
        wide = np.concatenate([WIDE[:1], knots, WIDE[1:]])
        values = np.pad(np.eye(len(knots)), ((0, 0), (1, 1)), mode="edge")
        return tuple(Spectrum(wide, row) for row in values)

    def of(self, colours: Sequence[Spectrum]) -> NDArray[np.float64]:
        """Values of colours at the wavelengths: (colours, n)."""
        return np.array([colour.at(self.wavelengths) for colour in colours])


def bands_of(
    albedos: Sequence[Spectrum], lamps: Sequence[Spectrum], tolerance: float = TOLERANCE, most: int = COUNTS[-1]
) -> Bands:
    """The fewest bands between which light of higher orders is linear to `tolerance`.

    What is looked at: powers of each of the `albedos` of a scene, all orders of each together in a thick layer, and
    products of two. The error is the largest, over triangular sensors 60 nm wide at half their height, anywhere in
    400–700 nm, and over all `lamps`, of the light that linear interpolation adds or takes away, as a share of the light
    of white. With the `most` bands, one of COUNTS, the error may be above it.
    """
    fine = np.arange(RANGE[0], RANGE[1] + 0.5 * STEP, STEP)
    values = np.array([np.clip(albedo.at(fine), 0.0, 1.0) for albedo in albedos])
    powers = np.concatenate([values**n for n in ORDERS] + [thick_layer(values)] + [one * values for one in values])
    sensors = np.maximum(1.0 - np.abs(fine[None] - np.arange(RANGE[0], RANGE[1] + 1.0, 10.0)[:, None]) / 60.0, 0.0)
    seen = np.concatenate([sensors * lamp.at(fine) for lamp in lamps])
    seen = seen[seen.sum(axis=1) > 1e-3 * seen.sum(axis=1).max()]
    seen /= seen.sum(axis=1, keepdims=True)
    chosen = None
    for n in (n for n in COUNTS if n <= most):
        knots = np.linspace(*RANGE, n)
        between = np.array([np.interp(fine, knots, np.interp(knots, fine, power)) for power in powers])
        chosen = Bands(knots, float(np.abs((between - powers) @ seen.T).max()))
        if chosen.error <= tolerance:
            return chosen
    assert chosen is not None
    return chosen


def thick_layer(albedo: NDArray[np.float64]) -> NDArray[np.float64]:
    """Light that a thick layer of matter of an `albedo` sends back, about (as if scattered alike all around)."""
    root = np.sqrt(np.maximum(1.0 - albedo, 0.0))
    return (1.0 - root) / (1.0 + root)
