"""Rig: how unevenly fixed lamps light the camera's field of view, told by the objects that stood in it.

Each object tells it where it stood (the evenness of its photometric fit); a flat field for another object is the mean
of what the others tell, carried on to where that one stands.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hagoromo.errors import InputError
from hagoromo.photograph.capture import Capture
from hagoromo.reflectance.photometric.normals import NormalMap
from hagoromo.reflectance.photometric.step import Prior
from hagoromo.reflectance.photometric.views import Array

# By what objects of one rig differ from the mean of the others, seen on six of them.
AFTER_RIG = Prior(strength=0.01, slope=0.03)
LEAST = 0.3  # evenness below which a linear fall-off has been carried on too far


@dataclass(frozen=True, eq=False)
class Unevenness:
    """Lamps as one object told them: ln strength (K,), fall-off (K, 2) [1/px] by column and row from `middle` (2,).

    What all lamps have in common is left out: it cannot be told from the body colours.
    """

    strength: Array
    slope: Array
    middle: Array

    def at(self, shape: tuple[int, int]) -> Array:
        """ln of the relative irradiance (K, h, w) over an image of `shape`."""
        rows, columns = np.mgrid[: shape[0], : shape[1]]
        away = np.stack([columns - self.middle[0], rows - self.middle[1]])
        falloff = 1.0 + np.tensordot(self.slope, away, axes=1)
        return self.strength[:, None, None] + np.log(np.maximum(falloff, LEAST))


def unevenness(found: NormalMap) -> Unevenness:
    """What the lamps' unevenness was over the object of `found`."""
    fit, seen = found.fit, found.seen
    radius = np.sqrt(len(seen.rows) / np.pi)
    middle = np.array([seen.columns.mean(), seen.rows.mean()])
    return Unevenness(fit.strength - fit.strength.mean(), (fit.slope - fit.slope.mean(axis=0)) / radius, middle)


def flat_field(told: Sequence[Unevenness], shape: tuple[int, int]) -> Array:
    """(K, h, w) relative irradiance of the lamps, the geometric mean of what several objects told."""
    if not told or len({len(one.strength) for one in told}) != 1:
        raise InputError("a flat field needs objects that were photographed under the same lamps: give one or more")
    return np.exp(np.mean([one.at(shape) for one in told], axis=0))


def flat_fielded(capture: Capture, field: Array) -> Capture:
    """`capture` as even lamps would show it: photograph k divided by `field` (K, h, w)."""
    if len(field) != len(capture.photographs):
        raise InputError(
            f"a flat field of {len(field)} lamps for {len(capture.photographs)} photographs: give one each"
        )
    even = [
        replace(photograph, values=photograph.values / flat, variance=photograph.variance / flat**2)
        for photograph, flat in zip(capture.photographs, field[..., None].astype(np.float32), strict=True)
    ]
    return replace(capture, photographs=tuple(even))
