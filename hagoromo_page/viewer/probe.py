"""Probe: the light of one pixel as a spectrum, and the colour difference of two."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.response import WHITE_XYZ, Response, camera_response, camera_white
from hagoromo.image.picture.image import Image
from hagoromo.light.colour import delta_e_2000, srgb_from_xyz
from hagoromo.reflectance.spectra.spectrum_estimate import SpectrumEstimate

WAVELENGTHS = np.arange(380.0, 781.0, 5.0)  # nm
NOISE_OF_95 = 1.96  # standard errors of a 95 % band


@dataclass(frozen=True, eq=False)
class Probe:
    """column, row: of the pixel, in a picture of `size` (width, height). values: (81,) at WAVELENGTHS, the light that
    the pixel sends, over that of a white diffuser which faces the first lamp at an irradiance of π of its spectrum.

    linear: (3,) linear sRGB with the first lamp as white. alpha: how much of the pixel is covered, 0…1.
    low, high: (81,) the limits of the 95 % band of `values`, where these have one. said: further lines.
    """

    column: int
    row: int
    size: tuple[int, int]
    values: NDArray[np.float64]
    linear: NDArray[np.float64]
    alpha: float
    low: NDArray[np.float64] | None = None
    high: NDArray[np.float64] | None = None
    said: tuple[str, ...] = ()

    def difference(self, other: Probe) -> float:
        """ΔE00 from another."""
        return float(delta_e_2000(self.linear, other.linear))


def probe(image: Image, x: float, y: float) -> Probe:
    """What stands at (x, y), shares 0…1 of the picture's width and height, from its upper left corner."""
    height, width = image.alpha.shape
    column, row = (int(np.clip(share * size, 0, size - 1)) for share, size in ((x, width), (y, height)))
    light, palette = image.weights[row, column].astype(np.float64), image.palette
    first, colours = palette.lamps[0], np.array([colour.at(WAVELENGTHS) for colour in palette.colours])
    lamps = np.array([lamp.at(WAVELENGTHS) for lamp in palette.lamps])
    radiance = np.einsum("kj,kw,jw->w", light.reshape(len(lamps), len(colours)), lamps, colours)
    of_first = first.at(WAVELENGTHS)
    values = np.divide(radiance, of_first, out=np.full_like(radiance, np.nan), where=of_first > 0.0)
    return Probe(column, row, (width, height), values, _linear(image, row, column), float(image.alpha[row, column]))


def with_spectrum(found: Probe, known: SpectrumEstimate, share: float = 1.0) -> Probe:
    """The probe with `share` of an estimated spectrum and its 95 % band; outside what was estimated there is none."""
    curves = (known.values, *known.band_95)
    inside = (WAVELENGTHS >= known.wavelengths[0]) & (WAVELENGTHS <= known.wavelengths[-1])
    values, low, high = (
        np.where(inside, share * np.interp(WAVELENGTHS, known.wavelengths, one), np.nan) for one in curves
    )
    return replace(found, values=values, low=low, high=high)


def _linear(image: Image, row: int, column: int) -> NDArray[np.float64]:
    """Linear sRGB of a pixel, exact: from the integrals of each colour under each lamp."""
    observer = Response.load("cie1931")
    palette, light = image.palette, image.weights[row, column].astype(np.float64)
    pairs = [(lamp, colour) for lamp in palette.lamps for colour in palette.colours]
    xyz = sum(
        weight * camera_response(colour, lamp, observer) for weight, (lamp, colour) in zip(light, pairs, strict=True)
    )
    return srgb_from_xyz(np.asarray(xyz) / camera_white(palette.lamps[0], observer) * WHITE_XYZ)


def plain(text: str) -> str:
    """Text in Markdown as it stands, whatever marks a name has: a link, a tag or a program is never made of it."""
    return re.sub(r"([\\`*_{}\[\]()<>#+\-!|~$&^@])", r"\\\1", text)


def probe_text(now: Probe, before: Probe | None) -> str:
    """A few lines on a probe and its difference from the one before, in Markdown."""
    lines = [f"pixel {now.column}, {now.row} of {now.size[0]} × {now.size[1]}, covered {100 * now.alpha:.0f} %"]
    lines += ["linear sRGB " + " ".join(f"{value:.4f}" for value in now.linear)]
    lines += [plain(line) for line in now.said]
    if before is not None:
        lines += [f"**ΔE00 {now.difference(before):.2f}** from pixel {before.column}, {before.row}"]
    return "  \n".join(lines)
