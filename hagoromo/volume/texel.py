"""Texel: a block of micro-structure that repeats along a surface, at several levels of detail.

After Kajiya & Kay, "Rendering Fur with Three Dimensional Textures" (1989), and Neyret, "Modeling, Animating, and
Rendering Complex Scenes Using Volumetric Textures" (1998). A box with a texel keeps a chart instead of matter: at every
voxel the height over a surface, u and v on it, and its frame (`chart`). Matter is looked up in the texel, at u and v
modulo its period, so memory is that of the two small boxes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import Array3f, Float, UInt, arrays
from hagoromo.errors import InputError

MOST_POPULATIONS = 4
RING_DEGREES = (0.0, 30.0, 60.0, 75.0)  # of directions from the normal, and so from its opposite; the last half as far
RINGS, TURNS = len(RING_DEGREES), 8  # directions on each ring
DIRECTIONS = 2 * RINGS * TURNS
LEAST_FACTOR = 1e-3  # on light
REFLECTED, ALL_PARTS = 2, 4  # parts of light that are scaled: body and interface; and the two that are transmitted
OLD_NUMBERS = 9  # that scaled the light of a population until version 0.2


class LightScale:
    """What the light that a population sends back, body and interface, is multiplied with: e to numbers from a table.

    Where populations of a scene transmit, what passes through them once and twice as far has factors, too.

    The table has a row per direction V to the eye and a column per direction L to a lamp, in the order of
    `table_directions`; logarithms are linear between them, and beyond the last ring as on it.
    """

    def __init__(self, table: Float, first: UInt, parts: int = REFLECTED) -> None:
        """table: logarithms, Float (tables · DIRECTIONS² · parts). first: number of the table of the population."""
        self._table, self._first, self._parts = table, first * (DIRECTIONS * DIRECTIONS), parts

    def at(self, eye: Array3f, lamp: Array3f) -> tuple[Float, ...]:
        """Factors on body, interface and other parts; `eye`, `lamp`: unit, Array3f along (u, v, normal)."""
        packet, lamps = arrays().Array2f if self._parts == REFLECTED else arrays().Array4f, table_places(lamp)
        logarithm = packet(0.0)
        for row, weight in table_places(eye):
            start = self._first + row * DIRECTIONS
            between = [dr.gather(packet, self._table, start + column) * share for column, share in lamps]
            logarithm = dr.fma(sum(between[1:], between[0]), weight, logarithm)
        return tuple(dr.exp(logarithm[part]) for part in range(self._parts))


def table_directions() -> NDArray[np.float64]:
    """Unit directions (u, v, normal) of the table: side (normal up, down), ring, turn: (DIRECTIONS, 3)."""
    side, ring, turn = (index.ravel() for index in np.indices((2, RINGS, TURNS)))
    angle, turn = np.radians(RING_DEGREES)[ring], 2.0 * np.pi / TURNS * turn
    across = np.sin(angle)
    return np.stack([across * np.cos(turn), across * np.sin(turn), np.where(side, -1.0, 1.0) * np.cos(angle)], axis=-1)


def table_places(way: Array3f) -> list[tuple[UInt, Float]]:
    """The four directions of the table around a unit one, Array3f: their numbers, and weights that sum to 1."""
    jit = arrays()
    angle = dr.acos(dr.fmin(dr.abs(way.z), 1.0)) * (180.0 / math.pi)
    wide, last = RING_DEGREES[1], RING_DEGREES[-2]
    angle = dr.fma(dr.fmax(angle - last, 0.0), 1.0 / (RING_DEGREES[-1] - last), dr.fmin(angle, last) / wide)
    angle = dr.fmin(angle, RINGS - 1 - 1e-4)
    turn = dr.atan2(way.y, way.x) * (0.5 * TURNS / math.pi)
    turn = dr.select(turn < 0.0, turn + TURNS, turn)
    ring, spoke = jit.UInt(angle), jit.UInt(turn)
    outwards, onwards = angle - jit.Float(ring), turn - jit.Float(spoke)
    start = dr.select(way.z < 0.0, jit.UInt(RINGS * TURNS), 0) + ring * TURNS
    spokes = spoke & (TURNS - 1), (spoke + 1) & (TURNS - 1)
    return [
        (start + k * TURNS + number, part * share)
        for k, part in enumerate((1.0 - outwards, outwards))
        for number, share in zip(spokes, (1.0 - onwards, onwards), strict=True)
    ]


def unscaled(populations: int, parts: int = REFLECTED) -> NDArray[np.float16]:
    """Logarithms of factors of 1: (populations, parts, DIRECTIONS, DIRECTIONS)."""
    return np.zeros((populations, parts, DIRECTIONS, DIRECTIONS), np.float16)


def scale_from_numbers(numbers: NDArray) -> NDArray[np.float16]:
    """Logarithms of the factors that version 0.2 made of its numbers c, (populations, 2, OLD_NUMBERS).

    c₀ + c₁ |V_n| + c₂ |L_n| + c₃ |V_n L_n| + c₄ V_u L_u + c₅ V_v L_v + c₆ (V_u² − V_v²) + c₇ (L_u² − L_v²), not
    below 0; c₈ where the lamp is behind the layer.
    """
    ways = table_directions()
    eye, lamp = (part.T[..., None] for part in (ways, ways))
    eye, lamp = eye, lamp.transpose(0, 2, 1)
    across = [way[0] ** 2 - way[1] ** 2 + 0.0 * eye[0] * lamp[0] for way in (eye, lamp)]
    up = [np.abs(way[2]) + 0.0 * eye[0] * lamp[0] for way in (eye, lamp)]
    features = [np.ones_like(up[0]), *up, up[0] * up[1], eye[0] * lamp[0], eye[1] * lamp[1], *across]
    front = np.einsum("pcf,fvl->pcvl", numbers[..., :-1].astype(float), np.stack(features))
    factors = np.where(eye[2] * lamp[2] < 0.0, numbers[..., -1][..., None, None], front)
    return np.log(np.maximum(factors, LEAST_FACTOR)).astype(np.float16)


@dataclass(frozen=True, eq=False)
class Level:
    """A texel at one fineness: values at the nodes of a lattice, all variants side by side along u.

    density: (populations, v, u, h) float16. axis: (populations, v, u, h, 3) float16, along u, v and the normal; means
    over coarse cells are shorter than 1. A variant of n cells has nodes k n … (k + 1) n: the border ones are shared.
    scale: logarithms of `LightScale` for body and interface, (populations, 2, DIRECTIONS, DIRECTIONS) float16, 4 in
    place of 2 where some transmit: what cells do not show of how the finest ones hide each other.
    """

    density: NDArray[np.float16]
    axis: NDArray[np.float16]
    scale: NDArray[np.float16]

    @property
    def nodes(self) -> tuple[int, int, int]:
        """Number of nodes along (v, u, h)."""
        _, v, u, h = self.density.shape
        return v, u, h

    @property
    def bytes(self) -> int:
        """Memory on the device [byte], at most: all populations together count as one, which has no axes, though."""
        return 8 * (self.density.size + self.density.size // len(self.density)) + 4 * self.scale.size


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

    @property
    def parts(self) -> int:
        """Number of parts of light that its levels scale: REFLECTED or ALL_PARTS."""
        return self.levels[0].scale.shape[1]

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
