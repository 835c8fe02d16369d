"""Rig: unevenness of the illumination by fixed lamps, and corrections of their directions, from several objects.

The photometric fit of each object estimates both where the object is. The flat field and lamps for another object are
the means over the other objects, extrapolated to its position.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

import hagoromo as hg

Array = NDArray[np.float64]
LEAST_EVENNESS = 0.3  # least evenness, which limits the extrapolation of a linear fall-off


@dataclass(frozen=True, eq=False)
class LampUnevenness:
    """Lamps as measured on one object: ln strength (K,), fall-off (K, 2) [1/px] by column and row from `middle` (2,).

    What all lamps have in common is left out: the body colours hide it. shift: (K, 3) of far lamps'
    directions [rad].
    """

    strength: Array
    slope: Array
    middle: Array
    shift: Array

    def at(self, shape: tuple[int, int]) -> Array:
        """ln of the relative irradiance (K, h, w) over an image of `shape`."""
        rows, columns = np.mgrid[: shape[0], : shape[1]]
        away = np.stack([columns - self.middle[0], rows - self.middle[1]])
        falloff = 1.0 + np.tensordot(self.slope, away, axes=1)
        return self.strength[:, None, None] + np.log(np.maximum(falloff, LEAST_EVENNESS))


def unevenness(solved: hg.NormalMap) -> LampUnevenness:
    """What the lamps' unevenness was over the object of `found`."""
    fit, pixels = solved.fit, solved.views
    radius = np.sqrt(len(pixels.rows) / np.pi)
    middle = np.array([pixels.columns.mean(), pixels.rows.mean()])
    slope = (fit.slope - fit.slope.mean(axis=0)) / radius
    return LampUnevenness(fit.strength - fit.strength.mean(), slope, middle, fit.shift)


def flat_field(rigs: Sequence[LampUnevenness], shape: tuple[int, int]) -> Array:
    """(K, h, w) relative irradiance of the lamps, the geometric mean of what several objects give."""
    if not rigs or len({len(one.strength) for one in rigs}) != 1:
        raise hg.InputError("a flat field needs objects that were photographed under the same lamps: give one or more")
    return np.exp(np.mean([one.at(shape) for one in rigs], axis=0))


def evened(capture: hg.Capture, rigs: Sequence[LampUnevenness], field: Array) -> hg.Capture:
    """`capture` as even lamps would show it: photograph k over `field` (K, h, w), lamps by the objects.

    Near lamps stay where they are.
    """
    if len(field) != len(capture.photographs):
        raise hg.InputError(
            f"a flat field of {len(field)} lamps for {len(capture.photographs)} photographs: give one each"
        )
    shift = np.mean([one.shift for one in rigs], axis=0)
    even = [
        replace(
            photograph,
            values=photograph.values / flat,
            variance=photograph.variance / flat**2,
            lamps=tuple(lamp.shifted(by) if lamp.position is None else lamp for lamp in photograph.lamps),
        )
        for photograph, flat, by in zip(capture.photographs, field[..., None].astype(np.float32), shift, strict=True)
    ]
    return replace(capture, photographs=tuple(even))
