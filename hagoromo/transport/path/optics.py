"""Optics: mirrors and smooth glass, from which a walk goes on in one direction, or one of two.

Glass is closed and stands in air or wholly in other glass: a walk that is refracted changes sides. With n its
refractive index over that around it, radiance falls by (1/n)² on its way in and rises by n² on its way out; within,
exp(−a d) of it is left after a distance d (Beer–Lambert).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import Array3f, Bool, Float, UInt, arrays, lookup
from hagoromo.reflectance.torrance_sparrow import fresnel
from hagoromo.transport.materials import Materials

NEITHER, MIRROR, GLASS = 0, 1, 2
KINDS = ("", "mirror", "glass")


@dataclass
class Turned:
    """How a walk goes on: whether by a mirror or glass; direction; factor on its radiance; whether through glass, and
    then in which, see `Optics.left`.
    """

    here: Bool
    direction: Array3f
    factor: Float
    refracted: Bool
    glass: UInt


class Optics:
    """The mirrors and glasses among the materials of a scene. bias: of the points of hits, along the normal [m]."""

    def __init__(
        self,
        kinds: Sequence[str],
        materials: Materials,
        bias: Float,
        around: NDArray[np.uint32],
        absorption: NDArray[np.float64] | None = None,
    ) -> None:
        """`kinds`: of KINDS, of every material. around: 1 + the number of the material in which a glass lies; 0: air.
        absorption: (materials, bands) [1/m]; None where all are clear.
        """
        self.materials, self.bias, self.around = materials, bias, lookup(arrays().UInt, around)
        self.kinds = lookup(arrays().UInt, np.array([KINDS.index(kind) for kind in kinds], np.uint32))
        self.bands = 0 if absorption is None else absorption.shape[1]
        self.absorption = None if absorption is None else lookup(arrays().Float, absorption.astype(np.float32))

    def left(self, glass: UInt, distance: Float, carried: list[Float]) -> list[Float]:
        """What is left of light in every band after a distance [m]. glass: 1 + the number of its material; 0: air."""
        if self.absorption is None:
            return carried
        there = (glass > 0) & dr.isfinite(distance)
        first = dr.select(there, glass - 1, 0) * self.bands
        rates = [dr.gather(arrays().Float, self.absorption, first + k, there) for k in range(self.bands)]
        way = dr.select(there, distance, 0.0)
        return [light * dr.exp(-rate * way) for light, rate in zip(carried, rates, strict=True)]

    def turned(self, material: UInt, there: Bool, normal: Array3f, to_eye: Array3f, glass: UInt, u: Float) -> Turned:
        """A walk at an event. normal: unit, to the eye. glass: in which the walk is. u: uniform in [0, 1)."""
        kind = dr.gather(arrays().UInt, self.kinds, material)
        is_glass, cosine = there & (kind == GLASS), dr.fmax(dr.dot(normal, to_eye), 0.0)
        around, within = dr.gather(arrays().UInt, self.around, material), glass == material + 1
        nested = around > 0
        outside = dr.select(nested, self.materials.read(dr.select(nested, around - 1, material), "n"), 1.0)
        n = self.materials.read(material, "n") / outside
        ratio = dr.select(within, n, dr.rcp(n))  # refractive index where the eye is, over that behind
        squared = 1.0 - ratio * ratio * (1.0 - cosine * cosine)
        behind = dr.sqrt(dr.fmax(squared, 0.0))
        reflected = dr.select(squared > 0.0, fresnel(dr.select(within, behind, cosine), n), 1.0)
        refracted = is_glass & (u >= reflected)
        mirrored = 2.0 * cosine * normal - to_eye
        through = (ratio * cosine - behind) * normal - ratio * to_eye
        direction = dr.normalize(dr.select(refracted, through, mirrored))
        factor = dr.select(refracted, ratio * ratio, 1.0)
        entered = dr.select(within, around, material + 1)
        return Turned(there & (kind != NEITHER), direction, factor, refracted, dr.select(refracted, entered, glass))
