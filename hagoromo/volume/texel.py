"""Texel: a block of micro-structure that repeats along a surface, at several levels of detail.

After Kajiya & Kay, "Rendering Fur with Three Dimensional Textures" (1989), and Neyret, "Modeling, Animating, and
Rendering Complex Scenes Using Volumetric Textures" (1998). A box with a texel keeps a chart instead of matter: at every
voxel the height over a surface, u and v on it, and its frame (`chart`). Matter is looked up in the texel, at u and v
modulo its period, so memory is that of the two small boxes.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import Array3f, Float
from hagoromo.errors import InputError

MOST_POPULATIONS = 4
SCALES = 9  # numbers that scale the light of a population, body or interface


@dataclass
class LightScale:
    """What light that a population sends back, body or interface, is multiplied with, by SCALES numbers.

    Of the directions V to the eye and L to a lamp along (u, v, normal): c₀ + c₁ |V_n| + c₂ |L_n| + c₃ |V_n L_n| +
    c₄ V_u L_u + c₅ V_v L_v + c₆ (V_u² − V_v²) + c₇ (L_u² − L_v²), not below 0; c₈ where the lamp is behind the layer.
    """

    numbers: list[Any]

    def at(self, eye: Array3f, lamp: Array3f) -> Float:
        """The factor; `eye`, `lamp`: unit, Array3f along (u, v, normal)."""
        front = sum(c * feature for c, feature in zip(self.numbers[:-1], light_features(eye, lamp), strict=True))
        return dr.select(eye.z * lamp.z < 0.0, self.numbers[-1], dr.fmax(front, 0.0))


def light_features(eye: Array3f, lamp: Array3f) -> list[Float]:
    """What the numbers of a `LightScale` but the last are multiplied with."""
    above_eye, above_lamp = dr.abs(eye.z), dr.abs(lamp.z)
    across = [dr.square(way.x) - dr.square(way.y) for way in (eye, lamp)]
    return [1.0, above_eye, above_lamp, above_eye * above_lamp, eye.x * lamp.x, eye.y * lamp.y, *across]


def unscaled(populations: int) -> NDArray[np.float32]:
    """Scales of 1: (populations, 2, SCALES)."""
    scale = np.zeros((populations, 2, SCALES), np.float32)
    scale[..., 0] = scale[..., -1] = 1.0
    return scale


@dataclass(frozen=True, eq=False)
class Level:
    """A texel at one fineness: values at the nodes of a lattice, all variants side by side along u.

    density: (populations, v, u, h) float16. axis: (populations, v, u, h, 3) float16, along u, v and the normal; means
    over coarse cells are shorter than 1. A variant of n cells has nodes k n … (k + 1) n: the border ones are shared.
    scale: numbers of `LightScale` for body and interface, (populations, 2, SCALES): what cells do not show.
    """

    density: NDArray[np.float16]
    axis: NDArray[np.float16]
    scale: NDArray[np.float32]

    @property
    def nodes(self) -> tuple[int, int, int]:
        """Number of nodes along (v, u, h)."""
        _, v, u, h = self.density.shape
        return v, u, h

    @property
    def bytes(self) -> int:
        """Memory on the device [byte]: all populations together have densities, too."""
        return 8 * (self.density.size + self.density.size // len(self.density))


@dataclass(frozen=True, eq=False)
class Texel:
    """period: along u and v [m]. bottom, top: heights over the surface [m]. levels: from the finest on.

    variants: blocks that may stand side by side; which of them does is random. Population k has material number k.
    """

    period: tuple[float, float]
    bottom: float
    top: float
    variants: int
    levels: tuple[Level, ...]

    def __post_init__(self) -> None:
        if not (min(self.period) > 0 and np.isfinite(self.period).all()):
            raise InputError(f"the period of a texel is {self.period}: give two finite lengths above 0")
        if not (np.isfinite(self.bottom) and np.isfinite(self.top) and self.bottom < self.top):
            raise InputError(f"a texel reaches from {self.bottom} to {self.top}: give finite heights, the lower first")
        if not 1 <= self.populations <= MOST_POPULATIONS:
            raise InputError(f"a texel has {self.populations} populations: give 1 to {MOST_POPULATIONS}")

    @property
    def populations(self) -> int:
        """Number of populations: sets of elements with a material, and in coarse levels a mean axis, of their own."""
        return len(self.levels[0].density)

    def record(self) -> dict[str, Any]:
        """Its numbers, without the arrays, as plain values."""
        return {
            "period": list(self.period), "bottom": self.bottom, "top": self.top, "variants": self.variants,
            "levels": len(self.levels),
        }  # fmt: skip

    @property
    def bytes(self) -> int:
        """Memory on the device [byte]."""
        return sum(level.bytes for level in self.levels)

    def cells(self, level: Level) -> tuple[int, int, int]:
        """Cells of a period along (u, v) and of the height."""
        v, u, h = level.nodes
        return (u - 1) // self.variants, v - 1, h - 1

    @cached_property
    def edges(self) -> NDArray[np.float64]:
        """Shortest edge of a cell of every level [m]."""
        size = np.array([*self.period, self.top - self.bottom])
        return np.array([(size / self.cells(level)).min() for level in self.levels])
