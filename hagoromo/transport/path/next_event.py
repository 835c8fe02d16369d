"""Next event: a lamp that lights a point, drawn by what each would give there if nothing stood between."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import drjit as dr

from hagoromo.backend import Array3f, Float, UInt, arrays
from hagoromo.transport.lighting import LampRow


class LampDrawn(NamedTuple):
    """Unit direction to the lamp, its distance [m], its irradiance facing it over its probability, and its group.

    tints: factor on the irradiance for every group, in place of one group; density: of the direction [1/sr], 0 where a
    walk cannot go there by chance. Both of lamps with a size, see `Lights`.
    """

    to_lamp: Array3f
    distance: Float
    irradiance: Float
    group: UInt
    tints: Sequence[Float] | None = None
    density: Float = 0.0


def lamp_drawn(lamps: Sequence[LampRow], point: Array3f, number: Float) -> LampDrawn:
    """One of the lamps for every point; `number`: uniform in [0, 1).

    A lamp is drawn in the share that it has of the irradiance, so that the irradiance over its probability is the sum
    of all of them, whichever it is.
    """
    jit = arrays()
    each = [lamp.light.arriving(point) for lamp in lamps]
    total = sum((irradiance for _, _, irradiance in each), jit.Float(0))
    to_lamp, distance, _ = each[0]
    distance, group, below = jit.Float(distance), jit.UInt(lamps[0].group), each[0][2]
    for lamp, (way, away, irradiance) in zip(lamps[1:], each[1:], strict=True):
        here = number * total >= below
        here &= irradiance > 0.0
        to_lamp, distance = dr.select(here, way, to_lamp), dr.select(here, away, distance)
        group, below = dr.select(here, lamp.group, group), below + irradiance
    return LampDrawn(to_lamp, distance, total, group)
