"""Colours: a spectrum of the package as a texture of the variant that Mitsuba has."""

from __future__ import annotations

from typing import Any

import numpy as np

from hagoromo.errors import InputError
from hagoromo.light.colour import linear_colour
from hagoromo.light.spectrum import Spectrum

NEEDED = (
    "scalar variants call Python once a ray, and polarised ones need Mueller matrices: call "
    "mitsuba.set_variant('llvm_ad_rgb'), or cuda_, _ad_spectral or _ad_mono"
)
LIMITS = 360.0, 830.0  # nm, of Mitsuba's spectra


def variant() -> tuple[Any, str]:
    """Mitsuba in the variant that it has, the package's own where none is set; and its colours: rgb, spectral, mono."""
    import mitsuba as mi

    if mi.variant() is None:
        from hagoromo.backend import mitsuba

        mi = mitsuba()
    colours = str(mi.variant()).partition("_ad_")[2]
    if colours not in ("rgb", "spectral", "mono"):
        raise InputError(f"Mitsuba's variant is {mi.variant()}, which has no plugin hagoromo: {NEEDED}")
    return mi, colours


def colour_of(spectrum: Spectrum, lamp: Spectrum | None = None) -> dict[str, Any]:
    """The dictionary of a texture with the values of a spectrum, in the variant that Mitsuba has.

    Spectral variants take the knots, held beyond their ends; rgb takes linear sRGB under `lamp` (None: D65), values
    below 0 cut off; mono its mean over what the eye sees of that lamp (Y). A constant keeps its number everywhere.
    """
    colours = variant()[1]
    if np.ptp(spectrum.values) == 0.0:
        value = float(spectrum.values[0])
        return (
            {"type": "rawconstant", "value": [value] * 3} if colours == "rgb" else {"type": "uniform", "value": value}
        )
    if colours == "spectral":
        held = spectrum.held(*LIMITS)
        waves, values = (", ".join(f"{x:.9g}" for x in row) for row in (held.wavelengths, held.values))
        return {"type": "irregular", "wavelengths": waves, "values": values}
    rgb = np.clip(linear_colour(spectrum, lamp or Spectrum.named("D65")), 0.0, None)
    if colours == "rgb":
        return {"type": "rawconstant", "value": rgb.tolist()}
    return {"type": "uniform", "value": float(rgb @ (0.2126, 0.7152, 0.0722))}
