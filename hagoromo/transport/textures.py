"""Textures: the texels of all boxes on the device, and look-ups of density, axis and light scale in them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import drjit as dr
import numpy as np

from hagoromo.backend import Array3f, Bool, Float, Int, UInt, arrays, clip, lookup
from hagoromo.transport.chart import PERIOD, ChartScale, SurfacePoint
from hagoromo.transport.texel_pools import TexelPools, pools_of
from hagoromo.volume.texel import LightScale, Texel
from hagoromo.volume.voxels import HALF_EXPONENT, axis_between, half_value, lerp

STEPS_PER_CELL = 2.0  # steps of a camera ray along the shortest edge of a cell
SHADOW_STEP = 2.0  # length of a step towards a lamp within the texel, in steps of a camera ray
HIDDEN_OPTICAL_DEPTH = 6.5  # a lamp behind it counts as hidden: exp(−6.5) = 1.5e-3 of its light
LONGEST_PATH = 6.0  # longest path of light through a texel, in thicknesses: farther the surface is not flat
MOST_SHADOW_STEPS = 64.0  # towards one lamp within the texel
HEIGHT_ERROR = 0.35  # [voxel] error of interpolated heights where sheets are close
CELL_MARGIN = 1e-3  # [cell] by which the last cell along the height ends before its last node


class SeenAlong(NamedTuple):
    """How a direction sees the elements of populations, in a box of projected extinction.

    area: (population, unit axis along u, v, normal) → projected area. tangents: see `Textures.axes`.
    """

    area: Callable[[int, Array3f], Float]
    tangents: Sequence[Bool | None]


@dataclass
class Corner:
    """The first node around a place, and where the place is between the eight, along (u, v, h)."""

    node: UInt
    part: Array3f  # 0…1


@dataclass
class TexelLevel:
    """A level of a texel as kernels read it."""

    offset: UInt  # of its first node in the pool of densities
    axes_behind: UInt  # how much farther on its first axis is in theirs, modulo 2³²
    across: UInt  # nodes along u, all variants
    high: UInt  # nodes along the height
    deep: UInt  # nodes along v
    cells: UInt  # of a period along u
    variants: UInt
    populations: UInt
    bottom: Float  # height of the lowest nodes [m]
    inverse: Float  # of the thickness [1/m]

    @property
    def nodes(self) -> UInt:
        """Number of nodes of one population."""
        return self.deep * self.across * self.high

    def corner(self, here: SurfacePoint) -> Corner:
        """The node, u and v being counted through the variant that stands there."""
        jit = arrays()
        variant = (_mixed(here.tile_u, here.tile_v) >> 16) * self.variants >> 16
        u, v = here.u * jit.Float(self.cells), here.v * jit.Float(self.deep - 1)
        h = clip((here.height - self.bottom) * self.inverse, 0.0, 1.0) * (jit.Float(self.high - 1) - CELL_MARGIN)
        column, row = dr.minimum(jit.UInt(u), self.cells - 1), dr.minimum(jit.UInt(v), self.deep - 2)
        node = jit.UInt(h)
        part = jit.Array3f(u - jit.Float(column), v - jit.Float(row), h - jit.Float(node))
        return Corner(self.offset + (row * self.across + variant * self.cells + column) * self.high + node, part)


class Textures:
    """Rows of numbers per box and per level, and the pools of all levels."""

    def __init__(
        self, boxes: Sequence[tuple[Texel | None, tuple[float, float], float]], finer: float = 1.0, kept: bool = True
    ) -> None:
        """boxes: of each its texel, band of heights [m] and voxel size [m]. finer: factor on the length of steps. kept:
        whether what is packed of the texels stays on the device for others, see `pools_of`.
        """
        jit = arrays()
        texels = list({id(texel): texel for texel, *_ in boxes if texel}.values())
        pools = pools_of(texels) if kept else TexelPools(texels)
        self.rows, self.axes_behind, self.scale = pools.rows, pools.axes_behind, pools.scale
        self.densities_pool, self.axes_pool = pools.densities, pools.axes
        first = np.cumsum([0, *(len(texel.levels) for texel in texels)])
        places = {id(texel): int(start) for texel, start in zip(texels, first, strict=False)}
        edges = np.concatenate([texel.edges for texel in texels])
        self.steps = lookup(jit.Float, (edges / STEPS_PER_CELL * finer).astype(np.float32))
        self.populations = max(texel.populations for texel in texels)
        self.parts = max(texel.parts for texel in texels)
        whole, floats = np.zeros((len(boxes), 4), np.uint32), np.ones((len(boxes), 8), np.float32)
        for numbers, row, (texel, band, voxel) in zip(whole, floats, boxes, strict=True):
            if texel:
                numbers[:] = places[id(texel)], len(texel.levels), texel.variants, texel.populations
                row[:4] = texel.bottom, 1.0 / (texel.top - texel.bottom), band[0], band[1] - band[0]
                row[4:8] = *(1.0 / np.array(texel.period)), 1.0 / texel.edges[0], voxel
        self.whole, self.floats = lookup(jit.UInt, whole), lookup(jit.Float, floats)
        dr.eval(self.steps, self.whole, self.floats)

    def textured(self, box: UInt) -> Bool:
        """Whether box number `box` has a texel."""
        return dr.gather(arrays().UInt, self.whole, box * 4 + 1) > 0

    def level(self, box: UInt, footprint: Float, dither: Float) -> tuple[UInt, Float]:
        """Row of the level whose cells are as wide as `footprint` [m], and its step [m].

        dither: 0…1, by which the level tends to the next coarser one.
        """
        jit = arrays()
        first, count, _, _ = dr.gather(jit.Array4u, self.whole, box)
        finest = dr.gather(jit.Float, self.floats, box * 8 + 6)
        octave = dr.fmax(dr.log2(dr.fmax(footprint * finest, 1e-6)) + dither, 0.0)
        row = first + dr.minimum(jit.UInt(octave), dr.maximum(count, 1) - 1)
        return row, dr.gather(jit.Float, self.steps, row)

    def footprint(self, box: UInt, row: UInt) -> Float:
        """A footprint [m] of which `level` gives this row of the box."""
        jit = arrays()
        octave = jit.Float(row - dr.gather(jit.UInt, self.whole, box * 4))
        return dr.exp2(octave + 0.5) / dr.gather(jit.Float, self.floats, box * 8 + 6)

    def clearance(self, box: UInt, share: Float) -> Float:
        """Least distance [m] from matter at a `share` 0…1 of the band of heights; 0 where there may be matter."""
        jit = arrays()
        bottom, inverse, low, span = dr.gather(jit.Array4f, self.floats, 2 * box)
        height, voxel = dr.fma(share, span, low), dr.gather(jit.Float, self.floats, box * 8 + 7)
        outside = dr.fmax(bottom - height, height - bottom - dr.rcp(inverse))
        return dr.fmax(dr.fma(voxel, -HEIGHT_ERROR, outside), 0.0)

    def chart_scale(self, box: UInt) -> ChartScale:
        """How the texel lies on the chart of a box."""
        _, _, low, span = dr.gather(arrays().Array4f, self.floats, 2 * box)
        per_u, per_v, _, voxel = dr.gather(arrays().Array4f, self.floats, 2 * box + 1)
        return ChartScale(per_u * PERIOD, per_v * PERIOD, voxel, low, span)

    def lattice(self, box: UInt, level: UInt) -> TexelLevel:
        """What look-ups in one level have in common."""
        jit = arrays()
        offset, across, high, packed = dr.gather(jit.Array4u, self.rows, level)
        behind = dr.gather(jit.UInt, self.axes_behind, level)
        _, _, variants, populations = dr.gather(jit.Array4u, self.whole, box)
        bottom, inverse, _, _ = dr.gather(jit.Array4f, self.floats, 2 * box)
        deep, cells = packed & 0xFFFF, packed >> 16
        return TexelLevel(offset, behind, across, high, deep, cells, variants, populations, bottom, inverse)

    def density(self, lattice: TexelLevel, here: SurfacePoint) -> Float:
        """Density of all populations together; 0 above and below the texel."""
        inside = dr.abs(dr.fma(here.height - lattice.bottom, lattice.inverse, -0.5)) < 0.5
        density = self._density(lattice, lattice.corner(here), arrays().UInt(0)) * here.presence
        return dr.select(inside, density, 0.0)

    def seen_densities(self, lattice: TexelLevel, here: SurfacePoint, seen: SeenAlong) -> list[Float]:
        """Density of every population times the projected area of its elements; 0 above and below the texel."""
        inside = dr.abs(dr.fma(here.height - lattice.bottom, lattice.inverse, -0.5)) < 0.5
        each = zip(self.densities(lattice, here), self.axes(lattice, here, seen.tangents), strict=True)
        return [
            dr.select(inside, density * seen.area(k, dr.normalize(axis + 1e-9)), 0.0)
            for k, (density, axis) in enumerate(each)
        ]

    def densities(self, lattice: TexelLevel, here: SurfacePoint) -> list[Float]:
        """Density of every population."""
        each = []
        for k in range(self.populations):
            number = dr.select(lattice.populations > k, arrays().UInt(k + 1), 0)
            value = self._density(lattice, lattice.corner(here), number) * here.presence
            each.append(dr.select(number > 0, value, 0.0))
        return each

    def axes(self, lattice: TexelLevel, here: SurfacePoint, tangents: Sequence[Bool | None]) -> list[Array3f]:
        """Axis of every population along (u, v, normal), not normalised; tangents: see `Voxels.axis`, of each."""
        corner = lattice.corner(here)
        steps = [h + v + u for h in (0, 1) for v in (0, lattice.across * lattice.high) for u in (0, lattice.high)]
        each = []
        for k in range(self.populations):
            number = dr.select(lattice.populations > k, k * lattice.nodes, 0)
            start = corner.node + lattice.axes_behind + number
            words = [dr.gather(arrays().Int, self.axes_pool, start + step) for step in steps]
            each.append(axis_between(words, corner.part, tangents[k]))
        return each

    def scales(self, level: UInt) -> list[LightScale]:
        """Factors on the light, of every part, that every population sends on."""
        return [LightScale(self.scale, level * self.populations + k, self.parts) for k in range(self.populations)]

    def optical_depth(
        self,
        box: UInt,
        level: UInt,
        here: SurfacePoint,
        way: Array3f,
        stop: Float,
        tau: Float,
        seen: SeenAlong | None = None,
        stride: float = SHADOW_STEP,
        presence: Callable[[Float], Float] | None = None,
    ) -> Float:
        """Optical depth along a straight `way` (u, v, normal; unit) out of the texel.

        The way ends at `stop` [m] if that is nearer. Beyond HIDDEN_OPTICAL_DEPTH the depth is cut short. The surface
        is taken for flat. seen: of the elements along the way; None where extinction is isotropic. stride: length of
        a step, in steps of a camera ray. presence: of the cloth at a distance along the way [m]; None: that of `here`.
        """
        jit, lattice, reach = arrays(), self.lattice(box, level), self.way_out(box, here.height, way.z, stop)
        per_metre = [dr.gather(jit.Float, self.floats, box * 8 + k) for k in (4, 5)]
        step = stride * dr.gather(jit.Float, self.steps, level)
        count = dr.fmin(dr.fmax(dr.ceil(reach / step), 1.0), MOST_SHADOW_STEPS)
        length = reach / count
        enough = HIDDEN_OPTICAL_DEPTH / (tau * length)

        def one(k: Float, passed: Float) -> tuple[Float, Float]:
            on = (k + 0.5) * length
            there = here.moved(on, way, per_metre)
            if presence is not None:
                there.presence = presence(on)
            density = sum(self.seen_densities(lattice, there, seen)) if seen else self.density(lattice, there)
            return k + 1.0, passed + density

        start = jit.Float(0), jit.Float(0)
        _, passed = dr.while_loop(start, lambda k, passed: (k < count) & (passed < enough), one)
        return tau * passed * length

    def way_out(self, box: UInt, height: Float, rise: Float, stop: Float) -> Float:
        """Length of a straight way out of the texel from a height [m] in it, or to `stop` [m] if that is nearer.

        rise: cosine of the way to the normal. No way is longer than LONGEST_PATH.
        """
        bottom, inverse, _, _ = dr.gather(arrays().Array4f, self.floats, 2 * box)
        thickness = dr.rcp(inverse)
        room = dr.select(rise > 0, bottom + thickness - height, height - bottom)
        return dr.fmin(room / dr.fmax(dr.abs(rise), 1e-4), dr.fmin(stop, LONGEST_PATH * thickness))

    def _density(self, lattice: TexelLevel, corner: Corner, number: UInt) -> Float:
        """Density of the population before `number`, of all together for 0."""
        rows, next_v = [], lattice.across * lattice.high
        start = corner.node + number * lattice.nodes
        for step in (0, lattice.high, next_v, next_v + lattice.high):
            pair = dr.gather(arrays().UInt, self.densities_pool, start + step)
            rows.append(lerp(half_value(pair << 13), half_value(pair >> 3), corner.part.z))
        low, high = lerp(rows[0], rows[1], corner.part.x), lerp(rows[2], rows[3], corner.part.x)
        return lerp(low, high, corner.part.y) * HALF_EXPONENT


def _mixed(u: Int, v: Int) -> UInt:
    """A random UInt for every pair of whole numbers (finalizer of MurmurHash3, Appleby 2011)."""
    UInt = arrays().UInt
    word = UInt(u) * 0x9E3779B1 + UInt(v) * 0x85EBCA77
    word = (word ^ (word >> 16)) * 0x85EBCA6B
    word = (word ^ (word >> 13)) * 0xC2B2AE35
    return word ^ (word >> 16)
