"""Voxels of the stored bricks on the device, and their interpolation at samples.

A brick stores 9³ voxels: its own 8³ and the next layer of its neighbours, so that trilinear interpolation stays inside.
Packed (7.6 bytes a voxel): densities from 6e-5 on as pairs of halves along x, so that four reads give the eight around
a sample; axes as 11, 11 and 10 bits (to 0.05°). Plain: four floats a voxel, by which the march can be differentiated.

Empty voxels have no say between voxels: their axes are stored as 0, and whatever else a voxel holds is weighed by its
density (`shares`; Wittenbrink, Malzbender & Goss 1998). The sign of a tangent has no meaning: see `between_tangents`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import drjit as dr
import numpy as np

from hagoromo.backend import Array3f, Array3u, Array4f, Bool, Float, Int, UInt, arrays, clip

BRICK = 8  # voxels a side
STORED = BRICK + 1  # voxels a side as stored
VOXELS = STORED**3
PAIRS = STORED * STORED * BRICK
SMALLEST_DENSITY = 2.0**-14  # less counts as 0: smaller halves would need denormal singles, which kernels flush
NO_MATTER = 1e-10  # added to plain densities, so that the light of matter has derivatives where there is none yet
HALF_EXPONENT = 2.0**112  # between the exponents of half and single precision: the same bits mean so much less
X_BITS, Y_BITS, Z_BITS = 11, 11, 10  # of an axis: x lowest
X_FULL, Y_FULL, Z_FULL = (float(2 ** (bits - 1) - 1) for bits in (X_BITS, Y_BITS, Z_BITS))
LONGEST_SQUARED_AXIS = 1.01  # squared length of a unit axis that was rounded; a longer axis is brought to 1
X_UNIT, Y_UNIT, Z_UNIT = 2.0 ** (X_BITS - 32) / X_FULL, 2.0 ** (Y_BITS - 32) / Y_FULL, 2.0 ** (Z_BITS - 32) / Z_FULL


class Voxels(Protocol):
    """Voxels as the march reads them: `brick` UInt, `place` lattice coordinates inside [0, n−1)."""

    def density(self, brick: UInt, place: Array3f | InCell) -> Float:
        """Trilinear density."""
        ...

    def densities_around(self, brick: UInt, place: Array3f | InCell) -> list[Float]:
        """Densities of the eight voxels around a place, in the order of CORNERS."""
        ...

    def axis(
        self, brick: UInt, place: Array3f | InCell, tangent: Bool | None = None, among: Sequence[Bool] | None = None
    ) -> Array3f:
        """Trilinear axis in box axes, not normalised.

        tangent: where axes are tangents, of either sign; None: nowhere. among: of the eight voxels in the order of
        CORNERS, those whose axes count; None: all.
        """
        ...


@dataclass
class InCell:
    """A place in a cell of eight voxels: what several places of one cell read of them is read once."""

    cell: Array3u  # lattice coordinates of its first voxel
    part: Array3f  # of the way from there to the last, 0…1

    @classmethod
    def of(cls, place: Array3f | InCell) -> InCell:
        """The place with these lattice coordinates."""
        if isinstance(place, InCell):
            return place
        cell = arrays().Array3u(place)
        return cls(cell, place - arrays().Array3f(cell))


@dataclass
class PackedVoxels:
    """densities: UInt (bricks · 648), halves at x and x + 1; axes: Int (bricks · 729)."""

    densities: UInt
    axes: Int

    def density(self, brick: UInt, place: Array3f | InCell) -> Float:
        """Trilinear density."""
        part = InCell.of(place).part
        rows = [lerp(half_value(pair << 13), half_value(pair >> 3), part.x) for pair in self._pairs(brick, place)]
        low, high = lerp(rows[0], rows[1], part.y), lerp(rows[2], rows[3], part.y)
        return lerp(low, high, part.z) * HALF_EXPONENT

    def densities_around(self, brick: UInt, place: Array3f | InCell) -> list[Float]:
        """Densities of the eight voxels around a place, in the order of CORNERS."""
        densities = []
        for pair in self._pairs(brick, place):
            densities += [half_value(pair << 13) * HALF_EXPONENT, half_value(pair >> 3) * HALF_EXPONENT]
        return densities

    def _pairs(self, brick: UInt, place: Array3f | InCell) -> list[UInt]:
        """The four pairs of halves around a place."""
        UInt = arrays().UInt
        inner = InCell.of(place).cell & (BRICK - 1)
        start = brick * PAIRS + (inner.z * STORED + inner.y) * BRICK + inner.x
        return [dr.gather(UInt, self.densities, start + r) for r in (0, BRICK, STORED * BRICK, (STORED + 1) * BRICK)]

    def axis(
        self, brick: UInt, place: Array3f | InCell, tangent: Bool | None = None, among: Sequence[Bool] | None = None
    ) -> Array3f:
        """Trilinear axis in box axes, not normalised; see `Voxels`."""
        jit = arrays()
        start, part = corner(brick, place)
        words = [dr.gather(jit.Int, self.axes, start + offset) for offset in CORNERS]
        if among is not None:
            words = [dr.select(counts, word, 0) for counts, word in zip(among, words, strict=True)]
        return axis_between(words, part, tangent)


@dataclass
class PlainVoxels:
    """values: Float (bricks · 729 · 4), density and axis. Derivatives are there of a density of 0, too."""

    values: Float

    def density(self, brick: UInt, place: Array3f | InCell) -> Float:
        """Trilinear density."""
        return trilinear(self.densities_around(brick, place), corner(brick, place)[1])

    def densities_around(self, brick: UInt, place: Array3f | InCell) -> list[Float]:
        """Densities of the eight voxels around a place, in the order of CORNERS."""
        return [packet[0] + NO_MATTER for packet in packets_around(self.values, brick, place)]

    def axis(
        self, brick: UInt, place: Array3f | InCell, tangent: Bool | None = None, among: Sequence[Bool] | None = None
    ) -> Array3f:
        """Trilinear axis in box axes, not normalised; see `Voxels`."""
        axes = [arrays().Array3f(p[1], p[2], p[3]) for p in packets_around(self.values, brick, place)]
        return between_axes(chosen_among(axes, among), corner(brick, place)[1], tangent)


@dataclass
class SplitVoxels:
    """Plain voxels with densities apart from axes: a gradient by densities alone costs no writes by axes.

    densities: Float (bricks · 729). axes: Float (bricks · 729 · 4), x, y, z and 0.
    """

    densities: Float
    axes: Float

    @classmethod
    def of(cls, plain: PlainVoxels) -> SplitVoxels:
        """The same voxels."""
        jit = arrays()
        lane = dr.arange(jit.UInt, dr.width(plain.values))
        part, values = lane & 3, dr.detach(plain.values)
        axes = dr.gather(jit.Float, values, lane + 1, part != 3)
        densities = dr.gather(jit.Float, values, dr.arange(jit.UInt, dr.width(values) // 4) * 4)
        dr.eval(densities, axes)
        return cls(densities, axes)

    def density(self, brick: UInt, place: Array3f | InCell) -> Float:
        """Trilinear density."""
        return trilinear(self.densities_around(brick, place), corner(brick, place)[1])

    def densities_around(self, brick: UInt, place: Array3f | InCell) -> list[Float]:
        """Densities of the eight voxels around a place, in the order of CORNERS."""
        start, _ = corner(brick, place)
        return [dr.gather(arrays().Float, self.densities, start + offset) + NO_MATTER for offset in CORNERS]

    def axis(
        self, brick: UInt, place: Array3f | InCell, tangent: Bool | None = None, among: Sequence[Bool] | None = None
    ) -> Array3f:
        """Trilinear axis in box axes, not normalised; see `Voxels`."""
        axes = [arrays().Array3f(p[0], p[1], p[2]) for p in packets_around(self.axes, brick, place)]
        return between_axes(chosen_among(axes, among), corner(brick, place)[1], tangent)


def chosen_among(axes: list[Array3f], among: Sequence[Bool] | None) -> list[Array3f]:
    """Axes of voxels that do not count as 0; None: all count."""
    if among is None:
        return axes
    return [dr.select(counts, axis, 0.0) for counts, axis in zip(among, axes, strict=True)]


CORNERS = tuple((z * STORED + y) * STORED + x for z in (0, 1) for y in (0, 1) for x in (0, 1))


def corner(brick: UInt, place: Array3f | InCell) -> tuple[UInt, Array3f]:
    """Number of the first of the eight voxels around a place, and where it is between them (0…1)."""
    place = InCell.of(place)
    inner = place.cell & (BRICK - 1)
    return brick * VOXELS + (inner.z * STORED + inner.y) * STORED + inner.x, place.part


def packets_around(grid: Float, brick: UInt, place: Array3f | InCell) -> list[Array4f]:
    """The packets of four of the eight voxels around a place, from a grid of halves or floats (bricks · 729 · 4)."""
    jit = arrays()
    kind = jit.Array4f16 if type(grid) is jit.Float16 else jit.Array4f
    start, _ = corner(brick, place)
    return [jit.Array4f(dr.gather(kind, grid, start + offset)) for offset in CORNERS]


def shares(voxels: Voxels, brick: UInt, place: Array3f | InCell) -> list[Float]:
    """What each of the eight voxels around a place adds to the density there, in the order of CORNERS."""
    weights = corner_weights(InCell.of(place).part)
    return [w * density for w, density in zip(weights, voxels.densities_around(brick, place), strict=True)]


def corner_weights(part: Array3f) -> list[Float]:
    """Trilinear weights of the eight voxels around a place that is `part` (0…1) of the way between them."""
    along = [(1.0 - part[k], part[k]) for k in range(3)]
    across = [z * y for z in along[2] for y in along[1]]
    return [zy * x for zy in across for x in along[0]]


def axis_between(words: list[Int], part: Array3f, tangent: Bool | None = None) -> Array3f:
    """Trilinear axis between eight packed ones (Int, in the order of CORNERS), not normalised: Array3f."""
    jit = arrays()
    # each number is read with the bits of the next below it, which stand for what `packed_axis` cut off
    axes = [jit.Array3f(word << (Y_BITS + Z_BITS), word << Z_BITS, word) for word in words]
    return between_axes(axes, part, tangent) * jit.Array3f(X_UNIT, Y_UNIT, Z_UNIT)


def between_axes(axes: list[Array3f], part: Array3f, tangent: Bool | None) -> Array3f:
    """Trilinear axis between eight, those of voxels without matter being 0, not normalised; tangent: see `Voxels`."""
    if tangent is None:
        return arrays().Array3f(*(trilinear([axis[k] for axis in axes], part) for k in range(3)))
    return between_tangents(axes, corner_weights(part), tangent)


def between_tangents(axes: list[Array3f], weights: list[Float], tangent: Bool) -> Array3f:
    """Σ w a over eight axes; where `tangent`, each with the sign that brings it to the side of the heaviest."""
    heaviest, most = axes[0], dr.select(dr.any(axes[0] != 0.0), weights[0], 0.0)
    for axis, weight in zip(axes[1:], weights[1:], strict=True):
        heavier = dr.any(axis != 0.0) & (weight > most)
        heaviest, most = dr.select(heavier, axis, heaviest), dr.select(heavier, weight, most)
    mean = arrays().Array3f(0.0)
    for axis, weight in zip(axes, weights, strict=True):
        opposite = tangent & (dr.dot(axis, heaviest) < 0.0)
        mean = dr.fma(axis, dr.select(opposite, -weight, weight), mean)
    return mean


def unpacked(word: Int) -> Array3f:
    """The axis of a packed one, Int: Array3f."""
    Float = arrays().Float
    return arrays().Array3f(
        Float(word << (Y_BITS + Z_BITS)) * X_UNIT, Float(word << Z_BITS) * Y_UNIT, Float(word) * Z_UNIT
    )


def packed_density(density: Float) -> UInt:
    """Pairs of halves of densities ≥ 0, Float (k · 729): UInt (k · 648)."""
    jit = arrays()
    density = dr.select(density < SMALLEST_DENSITY, 0.0, density)
    # a half's bits are those of the single 2¹¹² times smaller, without its last 13
    halves = dr.reinterpret_array(jit.UInt, jit.Float(jit.Float16(density)) * (1.0 / HALF_EXPONENT)) >> 13
    dr.eval(halves)
    pair = dr.arange(jit.UInt, dr.width(density) // VOXELS * PAIRS)
    voxel = pair // BRICK * STORED + pair % BRICK
    return dr.gather(jit.UInt, halves, voxel) | (dr.gather(jit.UInt, halves, voxel + 1) << 16)


def packed_axis(axis: Array3f) -> Int:
    """Bits of axes of length ≤ 1 (longer ones are brought to 1), Array3f: Int."""
    jit = arrays()
    squared = dr.squared_norm(axis)
    axis = axis * dr.select(squared > LONGEST_SQUARED_AXIS, dr.rsqrt(squared), 1.0)
    axis = jit.Array3f(*(clip(axis[k], -1.0, 1.0) for k in range(3)))
    x = jit.Int(dr.round(axis.x * X_FULL)) & (2**X_BITS - 1)
    y, z = jit.Int(dr.floor(axis.y * Y_FULL)), jit.Int(dr.floor(axis.z * Z_FULL))
    return x | ((y & (2**Y_BITS - 1)) << X_BITS) | (z << (X_BITS + Y_BITS))


def unpacked_density(pairs: np.ndarray) -> np.ndarray:
    """Densities of packed pairs, uint32 (k · 648): float16 (k, 9, 9, 9)."""
    pairs = pairs.reshape(-1, STORED, STORED, BRICK)
    low, last = pairs & 0xFFFF, pairs[..., -1:] >> 16
    return np.concatenate([low, last], axis=-1).astype(np.uint16).view(np.float16)


def paired_density(halves: np.ndarray, pairs: np.ndarray) -> None:
    """Pack densities, bits of halves uint16 (k, 9, 9, 9), contiguous, into `pairs`, uint32 (k · 648)."""
    rows = pairs.reshape(-1, BRICK)
    # two halves that are neighbours are a pair as they lie in memory, off the alignment of whole ones
    neighbours = np.ndarray(rows.shape, np.dtype("<u4"), halves.data, strides=(2 * STORED, 2))
    rows[...] = neighbours


def unpacked_axis(axes: np.ndarray) -> np.ndarray:
    """Axes of their bits, int32 (k · 729): float16 (k, 9, 9, 9, 3). Packed again they give the same bits."""
    x, y, z = axes << (Y_BITS + Z_BITS) >> (Y_BITS + Z_BITS), axes << Z_BITS >> (X_BITS + Z_BITS), axes >> (32 - Z_BITS)
    axis = np.stack([x / X_FULL, (y + 0.5) / Y_FULL, (z + 0.5) / Z_FULL], axis=-1).clip(-1.0, 1.0)
    axis[axes == 0] = 0.0
    return axis.astype(np.float16).reshape(-1, STORED, STORED, STORED, 3)


def half_value(bits: UInt) -> Float:
    """The float, 2¹¹² times too small, of a half whose bits stand 13 places up (others are masked)."""
    return dr.reinterpret_array(arrays().Float, bits & 0x0FFFE000)


def lerp(begin: Float, end: Float, part: Float) -> Float:
    """Linear between `begin` (part 0) and `end` (1)."""
    return dr.fma(end - begin, part, begin)


def trilinear(values: list[Float], part: Array3f) -> Float:
    """Between eight values in the order of CORNERS."""
    along = [lerp(values[k], values[k + 1], part.x) for k in (0, 2, 4, 6)]
    return lerp(lerp(along[0], along[1], part.y), lerp(along[2], along[3], part.y), part.z)
