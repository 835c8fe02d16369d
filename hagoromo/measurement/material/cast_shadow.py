"""Cast shadows on a known shape: photographs that show a pixel far darker than the others of it do.

The lamp that throws the shadow reaches the pixel by its normal, but something stands in its way. Such a value says
nothing of the reflectance. A robust fit of a whole material leaves it out; of one pixel, which a few photographs show,
it would take a fifth or a third for gloss.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hagoromo.measurement.observations import Pixels, known_shape
from hagoromo.measurement.sight import Array, sight_of
from hagoromo.photograph.capture import Capture

SHADOWED = 0.2  # of the value that the median of the photographs lets expect: below, a pixel lies in cast shadow
MATTE = 0.35  # [rad] smallest φ above which a pixel shows more of its body than of its highlight
WELL_LIT = 0.3  # of the light in the photograph that lights a pixel most: below, a grazing pixel may look too bright
DUSK = 0.85  # of that value: below, a pixel that touches a shadow lies in its soft edge
WIDEST = 12  # [px] width of a soft edge
DULL = 25.0  # percentile of value over light within a material: a highlight makes the others of a pixel look dark
FEWEST_SEEN = 3  # photographs of a pixel, of which the median is one that is not in shadow
FEWEST_SHADOWED = 9  # pixels of one shadow: fewer are noise, dust or the edge of another material


@dataclass(frozen=True, eq=False)
class PixelLight:
    """What K photographs show of M pixels, each summed over the channels.

    value, error: (K, M) and its standard deviation. bodies: of each photograph, `Sight.body` (M, C); light: (K, M) the
    same. usable: (K, M) whether the value is valid, lit and not seen at a grazing angle. least_half_angle: (K, M) to a
    highlight [rad].
    """

    value: Array
    error: Array
    bodies: tuple[Array, ...]
    light: Array
    usable: NDArray[np.bool_]
    least_half_angle: Array

    @staticmethod
    def on(capture: Capture, pixels: Pixels) -> PixelLight:
        """What the photographs of a capture show of some pixels."""
        index, photographs = (pixels.rows, pixels.columns), capture.photographs
        value = np.stack([one.values[index].sum(axis=1, dtype=np.float64) for one in photographs])
        variance = np.stack([one.variance[index].sum(axis=1, dtype=np.float64) for one in photographs])
        bodies, usable, angles = [], [], []
        for one in photographs:
            sight = sight_of(one, pixels.points, pixels.normals)
            bodies.append(sight.body)
            usable.append(sight.fit_to_use & one.mask[index])
            angles.append(sight.least_half_angle)
        light = np.stack([body.sum(axis=1) for body in bodies])
        return PixelLight(value, np.sqrt(variance), tuple(bodies), light, np.stack(usable), np.stack(angles))

    @property
    def ratio(self) -> Array:
        """(K, M) value over light, NaN where it is not usable."""
        lit = self.usable & (self.light > 0.0)
        return np.where(lit, self.value / np.where(lit, self.light, 1.0), np.nan)

    def darker_than(self, usual: Array | float) -> NDArray[np.bool_]:
        """(K, M) whether a value is, beyond noise, below what the ratio `usual`, (M,) or one, lets expect."""
        return self.value + 3.0 * self.error < usual * self.light

    def darker_than_the_others(self, share: float = SHADOWED) -> NDArray[np.bool_]:
        """(K, M) photographs that show a pixel darker than `share` of what the median of all shows, or of what the
        brightest surely shows of its body: most of a few may lie in shadow.
        """
        sure = self.usable & (self.least_half_angle >= MATTE) & (self.light > WELL_LIT * self.light.max(axis=0))
        body = np.where(sure, self.value - 3.0 * self.error, 0.0) / np.where(sure, self.light, 1.0)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # pixels that no photograph shows
            return self.darker_than(share * np.fmax(np.nanmedian(self.ratio, axis=0), body.max(axis=0)))


def without_cast_shadows(capture: Capture, labels: NDArray[np.integer]) -> tuple[Capture, NDArray[np.bool_]]:
    """`capture` with masked cast shadows, and these: (K, h, w), with their soft edges and the pixels around them.

    labels: (h, w) materials. A value counts as shadowed that is far darker than the other photographs of its pixel let
    expect and than the duller part of its material does; a shadow has FEWEST_SHADOWED pixels that touch. Its soft edge
    is what is darker than usual around it.
    """
    from scipy.ndimage import binary_dilation, label

    shadows = np.zeros((len(capture.photographs), *labels.shape), bool)
    around = np.ones((3, 3))
    for number in np.unique(labels[labels >= 0]):
        region = (labels == number) & known_shape(capture)
        pixels = Pixels.where(capture, region)
        index = pixels.rows, pixels.columns
        light = PixelLight.on(capture, pixels)
        known = light.ratio[np.isfinite(light.ratio)]
        if not known.size:
            continue
        compared = light.usable & (light.usable.sum(axis=0) >= FEWEST_SEEN)
        dull = float(np.percentile(known, DULL))
        dark, dusky = (
            compared & light.darker_than_the_others(share) & light.darker_than(share * dull)
            for share in (SHADOWED, DUSK)
        )
        for shadow, found, beside in zip(shadows, dark, dusky, strict=True):
            on, edge = np.zeros(labels.shape, bool), np.zeros(labels.shape, bool)
            on[index], edge[index] = found, beside
            parts, count = label(on, around)
            large = np.flatnonzero(np.bincount(parts.ravel(), minlength=count + 1) >= FEWEST_SHADOWED)
            on &= np.isin(parts, large)
            if on.any():
                on = binary_dilation(on, around, WIDEST, on | edge)
                shadow |= np.asarray(binary_dilation(on, around), np.bool_) & region
    if not shadows.any():
        return capture, shadows
    lit = (
        replace(photograph, mask=photograph.mask & ~shadow)
        for photograph, shadow in zip(capture.photographs, shadows, strict=True)
    )
    return replace(capture, photographs=tuple(lit)), shadows
