"""SurfaceEmission: the light that a surface gives off by itself, from its front, alike into every direction."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from hagoromo.errors import InputError
from hagoromo.light.spectrum import Spectrum, checked_spectrum


@dataclass(frozen=True)
class SurfaceEmission:
    """radiance: [W/(m² sr) times the unit of `spectrum`], the same all over the front of a surface and into all
    directions (Lambert's law). spectrum: relative spectrum. name: in pictures; empty: that of the surface.

    The front is where the corners of a face go round counterclockwise; that of a shape is outside, or +z. The surface
    reflects light besides. `InputError` for a radiance that is not above 0.
    """

    radiance: float
    spectrum: Spectrum = field(default_factory=lambda: Spectrum.constant(1.0))
    name: str = ""

    def __post_init__(self) -> None:
        if not (np.isfinite(self.radiance) and self.radiance > 0.0):
            raise InputError(f"the radiance of an emission is {self.radiance!r:.60}: give a finite number above 0")
        checked_spectrum(self.spectrum, "emission: spectrum")
        if not (self.spectrum.values >= 0.0).all() or not self.spectrum.values.any():
            raise InputError("the spectrum of an emission is below 0 somewhere, or 0 everywhere: give one of light")

    def record(self) -> dict[str, object]:
        """The emission as plain values, as a scene file states it."""
        return {"radiance": self.radiance, "spectrum": self.spectrum.record(), "name": self.name}
