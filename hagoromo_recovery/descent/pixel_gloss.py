"""Pixel gloss: the gloss by what whole pixels show of the surface that was found.

A step of the descent marches one ray through the middle of each pixel. Within a pixel the normals of a curved surface
turn, so that a photograph shows highlights wider and fainter than such rays do, and γ comes out too large, as much as
pixels are large. All photographs do so alike, so no difference between them shows it. The mean light of four rays a
pixel, at the points of Gauss, does.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import Float, arrays
from hagoromo_recovery.descent.gloss_step import Slopes, gloss_step, slopes_of
from hagoromo_recovery.descent.pixel_table import CHUNK, Drawn
from hagoromo_recovery.field.matter_field import COLOURS

if TYPE_CHECKING:
    from hagoromo_recovery.descent.descent import Descent

POINT = 0.5 / 3.0**0.5  # px from the middle of a pixel: a mean over both sides is exact for cubic functions
STEPS, AT_ONCE, MOST_CHUNKS = 3, 1 << 12, 1 << 13  # of Gauss and Newton; chunks


def pixel_gloss(descent: Descent) -> NDArray[np.float64]:
    """The numbers of the gloss by whole pixels, see `coordinates`; the descent keeps its own."""
    own, total = descent.gloss, descent.pixels.count // CHUNK
    chosen = np.sort(np.random.default_rng(0).permutation(total)[:MOST_CHUNKS])
    for _ in range(STEPS):
        parts = [_slopes(descent, chosen[first : first + AT_ONCE]) for first in range(0, len(chosen), AT_ONCE)]
        slopes = Slopes(*(np.concatenate(each) for each in zip(*parts, strict=True)))
        descent.shading.set_gloss(gloss_step(descent.gloss, slopes, total / len(chosen)))
    found = descent.gloss
    descent.shading.set_gloss(own)
    return found


def _slopes(descent: Descent, chunks: NDArray[np.integer]) -> Slopes:
    drawn = descent.pixels.of(chunks)
    return slopes_of(descent.rendering, drawn, light_of_pixels(descent, drawn))


def light_of_pixels(descent: Descent, drawn: Drawn) -> list[Float]:
    """Light of every channel, as a mean over each pixel."""
    total = [arrays().Float(0.0)] * COLOURS
    for right in (-POINT, POINT):
        for down in (-POINT, POINT):
            light = descent.rendering.light(descent.pixels.beside(drawn, right, down))
            total = [a + 0.25 * b for a, b in zip(total, light.channels, strict=True)]
            dr.eval(total)
    return total
