"""Probe: the light of one pixel as a spectrum, and the colour difference of two."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.response import Response, camera_response, camera_white
from hagoromo.camera.srgb_from_camera import WHITE_XYZ
from hagoromo.image.image import Image
from hagoromo.light.colour import delta_e_2000, srgb_from_xyz

WAVELENGTHS = np.arange(380.0, 781.0, 5.0)  # nm


@dataclass(frozen=True, eq=False)
class Probe:
    """column, row: of the pixel, in a picture of `size` (width, height). values: (81,) at WAVELENGTHS, the light that
    the pixel sends, over that of a white diffuser which faces the first lamp at an irradiance of π of its spectrum.

    linear: (3,) linear sRGB with the first lamp as white. alpha: how much of the pixel is covered, 0…1.
    """

    column: int
    row: int
    size: tuple[int, int]
    values: NDArray[np.float64]
    linear: NDArray[np.float64]
    alpha: float

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


def _linear(image: Image, row: int, column: int) -> NDArray[np.float64]:
    """Linear sRGB of a pixel, exact: from the integrals of each colour under each lamp."""
    observer = Response.load("cie1931")
    palette, light = image.palette, image.weights[row, column].astype(np.float64)
    pairs = [(lamp, colour) for lamp in palette.lamps for colour in palette.colours]
    xyz = sum(
        weight * camera_response(colour, lamp, observer) for weight, (lamp, colour) in zip(light, pairs, strict=True)
    )
    return srgb_from_xyz(np.asarray(xyz) / camera_white(palette.lamps[0], observer) * WHITE_XYZ)


def probe_text(now: Probe, before: Probe | None) -> str:
    """A few lines on a probe and its difference from the one before, in Markdown."""
    lines = [f"pixel {now.column}, {now.row} of {now.size[0]} × {now.size[1]}, covered {100 * now.alpha:.0f} %"]
    lines += ["linear sRGB " + " ".join(f"{value:.4f}" for value in now.linear)]
    if before is not None:
        lines += [f"**ΔE00 {now.difference(before):.2f}** from pixel {before.column}, {before.row}"]
    return "  \n".join(lines)
