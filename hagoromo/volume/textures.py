"""Textures: the texels of a scene's boxes on the device, and how kernels look matter up in them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import arrays, check_entries, clip, lookup
from hagoromo.files.door import check_memory
from hagoromo.volume.box import VolumeBox
from hagoromo.volume.chart import OnSurface
from hagoromo.volume.texel import Level, Texel
from hagoromo.volume.voxels import HALF_EXPONENT, SMALLEST, axis_between, half_value, packed_axis

STEPS = 2.0  # per shortest edge of a cell
EDGE = 1e-3  # the last cell along the height ends this much before its last node [cell]


class Textures:
    """Rows of numbers per box and per level, and the pools of all levels."""

    def __init__(self, boxes: Sequence[VolumeBox], finer: float) -> None:
        """`finer`: factor on the length of steps, see `Frames`."""
        kinds = arrays()
        texels = list({id(box.texel): box.texel for box in boxes if box.texel}.values())
        levels = [level for texel in texels for level in texel.levels]
        count = sum(level.density.size for level in levels)
        check_entries(count, "the texels of all boxes together")
        check_memory(8 * count, "the texels of all boxes together")
        first = np.cumsum([0, *(len(texel.levels) for texel in texels)])
        places = {id(texel): int(start) for texel, start in zip(texels, first, strict=False)}
        offsets = np.cumsum([0, *(level.density.size for level in levels)])
        rows = [_level_row(texel, level) for texel in texels for level in texel.levels]
        words = np.array([(offset, *row) for offset, row in zip(offsets, rows, strict=False)], np.uint32)
        self.rows = lookup(kinds.UInt, words)
        edges = np.concatenate([texel.edges for texel in texels])
        self.steps = lookup(kinds.Float, (edges / STEPS * finer).astype(np.float32))
        self.populations = max(texel.populations for texel in texels)
        scale = np.zeros((len(levels), self.populations, 2), np.float32)
        for row, level in zip(scale, levels, strict=True):
            row[: len(level.scale)] = level.scale
        self.scale = lookup(kinds.Float, scale)
        whole, floats = np.zeros((len(boxes), 4), np.uint32), np.ones((len(boxes), 8), np.float32)
        for numbers, row, box in zip(whole, floats, boxes, strict=True):
            if texel := box.texel:
                numbers[:] = places[id(texel)], len(texel.levels), texel.variants, texel.populations
                row[:4] = texel.bottom, 1.0 / (texel.top - texel.bottom), box.band[0], box.band[1] - box.band[0]
                row[4:7] = *(1.0 / np.array(texel.period)), 1.0 / texel.edges[0]
        self.whole, self.floats = lookup(kinds.UInt, whole), lookup(kinds.Float, floats)
        self.densities_pool = lookup(kinds.UInt, np.concatenate([_pairs(level) for level in levels]))
        self.axes_pool = dr.concat([_axes(level) for level in levels])
        dr.eval(self.rows, self.steps, self.scale, self.whole, self.floats, self.densities_pool, self.axes_pool)

    def textured(self, box: Any) -> Any:
        """Whether box number `box` has a texel."""
        return dr.gather(arrays().UInt, self.whole, box * 4 + 1) > 0

    def level(self, box: Any, footprint: Any, dither: Any) -> tuple[Any, Any]:
        """Row of the level whose cells are as wide as `footprint` [m], and its step [m].

        dither: 0…1, by which the level tends to the next coarser one.
        """
        kinds = arrays()
        first, count, _, _ = dr.gather(kinds.Array4u, self.whole, box)
        finest = dr.gather(kinds.Float, self.floats, box * 8 + 6)
        octave = dr.fmax(dr.log2(dr.fmax(footprint * finest, 1e-6)) + dither, 0.0)
        row = first + dr.minimum(kinds.UInt(octave), dr.maximum(count, 1) - 1)
        return row, dr.gather(kinds.Float, self.steps, row)

    def height(self, box: Any, share: Any) -> tuple[Any, Any]:
        """Height over the surface [m] of a share of the band, and how far that is from matter [m]; 0 within."""
        bottom, inverse, low, span = dr.gather(arrays().Array4f, self.floats, 2 * box)
        height = dr.fma(share, span, low)
        return height, dr.fmax(dr.fmax(bottom - height, height - bottom - dr.rcp(inverse)), 0.0)

    def densities(self, box: Any, level: Any, here: OnSurface) -> list[Any]:
        """Density of every population."""
        kinds = arrays()
        start, next_v, next_u, each, part = self._cell(box, level, here)
        many = dr.gather(kinds.UInt, self.whole, box * 4 + 3)
        found = []
        for k in range(self.populations):
            has = many > k
            rows = []
            for corner in (0, next_u, next_v, next_v + next_u):
                pair = dr.gather(kinds.UInt, self.densities_pool, start + k * each + corner, has)
                rows.append(_lerp(half_value(pair << 13), half_value(pair >> 3), part.z))
            value = _lerp(_lerp(rows[0], rows[1], part.x), _lerp(rows[2], rows[3], part.x), part.y)
            found.append(value * (HALF_EXPONENT * here.presence))
        return found

    def axes(self, box: Any, level: Any, here: OnSurface) -> list[Any]:
        """Axis of every population along (u, v, normal), not normalised."""
        kinds = arrays()
        start, next_v, next_u, each, part = self._cell(box, level, here)
        found = []
        for k in range(self.populations):
            first = start + dr.select(dr.gather(kinds.UInt, self.whole, box * 4 + 3) > k, k * each, 0)
            corners = [first + h + u + v for h in (0, 1) for v in (0, next_v) for u in (0, next_u)]
            found.append(axis_between([dr.gather(kinds.Int, self.axes_pool, corner) for corner in corners], part))
        return found

    def scales(self, level: Any) -> list[tuple[Any, Any]]:
        """Factors on the light, body and interface, that every population sends back."""
        kinds, rows = arrays(), level * (2 * self.populations)
        return [
            (dr.gather(kinds.Float, self.scale, rows + 2 * k), dr.gather(kinds.Float, self.scale, rows + 2 * k + 1))
            for k in range(self.populations)
        ]

    def through(self, box: Any, level: Any, here: OnSurface, way: Any, stop: Any) -> tuple[Any, Any]:
        """Density · length [m] along a straight `way` (along u, v, normal; unit) out of the texel, and its length [m].

        It ends at `stop` [m] if that is nearer. The surface is taken to be flat there.
        """
        kinds = arrays()
        bottom, inverse, _, _ = dr.gather(kinds.Array4f, self.floats, 2 * box)
        inverse_u, inverse_v = (dr.gather(kinds.Float, self.floats, box * 8 + k) for k in (4, 5))
        step = dr.gather(kinds.Float, self.steps, level)
        thickness = dr.rcp(inverse)
        rising = way.z > 0
        room = dr.select(rising, bottom + thickness - here.height, here.height - bottom)
        reach = dr.fmin(room / dr.fmax(dr.abs(way.z), 1e-4), dr.fmin(stop, FARTHEST * thickness))
        count = dr.ceil(reach / (WITHIN * step))
        count = dr.fmin(dr.fmax(count, 1.0), MOST_STEPS)
        length = reach / count

        def one(k: Any, passed: Any) -> tuple[Any, Any]:
            way_on = (k + 0.5) * length
            u, v = dr.fma(way_on, way.x * inverse_u, here.u), dr.fma(way_on, way.y * inverse_v, here.v)
            over_u, over_v = dr.floor(u), dr.floor(v)
            there = OnSurface(
                here.tile_u + kinds.Int(over_u), here.tile_v + kinds.Int(over_v), u - over_u, v - over_v,
                dr.fma(way_on, way.z, here.height), here.presence,
            )  # fmt: skip
            return k + 1.0, passed + sum(self.densities(box, level, there)) * length

        _, passed = dr.while_loop((kinds.Float(0), kinds.Float(0)), lambda k, passed: k < count, one)
        return passed, reach

    def _cell(self, box: Any, level: Any, here: OnSurface) -> tuple[Any, Any, Any, Any, Any]:
        """Number of the first node around a place, from it to the next along v and u, nodes of a population, parts."""
        kinds = arrays()
        offset, across, high, packed = dr.gather(kinds.Array4u, self.rows, level)
        deep, cells = packed & 0xFFFF, packed >> 16
        bottom, inverse, _, _ = dr.gather(kinds.Array4f, self.floats, 2 * box)
        variants = dr.gather(kinds.UInt, self.whole, box * 4 + 2)
        variant = (_mixed(here.tile_u, here.tile_v) >> 16) * variants >> 16
        u, v = here.u * kinds.Float(cells), here.v * kinds.Float(deep - 1)
        h = clip((here.height - bottom) * inverse, 0.0, 1.0) * (kinds.Float(high - 1) - EDGE)
        column = dr.minimum(kinds.UInt(u), cells - 1)
        row, node = dr.minimum(kinds.UInt(v), deep - 2), kinds.UInt(h)
        part = kinds.Array3f(u - kinds.Float(column), v - kinds.Float(row), h - kinds.Float(node))
        start = offset + (row * across + variant * cells + column) * high + node
        return start, across * high, high, deep * across * high, part


WITHIN = 1.0  # steps of a ray from the eye, that a step to a lamp within the texel is long
FARTHEST = 6.0  # thicknesses that light comes through a texel at most: beyond, the surface is not flat
MOST_STEPS = 64.0


def _mixed(u: Any, v: Any) -> Any:
    """A random UInt for every pair of whole numbers (finalizer of MurmurHash3, Appleby 2011)."""
    UInt = arrays().UInt
    word = UInt(u) * 0x9E3779B1 + UInt(v) * 0x85EBCA77
    word = (word ^ (word >> 16)) * 0x85EBCA6B
    word = (word ^ (word >> 13)) * 0xC2B2AE35
    return word ^ (word >> 16)


def _level_row(texel: Texel, level: Level) -> tuple[int, int, int]:
    """Nodes along u, nodes along h, and nodes along v with cells of a period along u above them."""
    v, u, h = level.nodes
    check_entries(max(v, u // texel.variants) << 16, "a side of a texel")
    return u, h, v | (texel.cells(level)[0] << 16)


def _pairs(level: Level) -> NDArray[np.uint32]:
    """Densities as halves, each with the next above it."""
    halves = np.where(level.density < SMALLEST, np.float16(0), level.density).view(np.uint16).astype(np.uint32)
    above = np.concatenate([halves[..., 1:], np.zeros_like(halves[..., :1])], axis=-1)
    return (halves | above << np.uint32(16)).ravel().astype(np.uint32)


def _axes(level: Level) -> Any:
    kinds = arrays()
    return packed_axis(kinds.Array3f(dr.unravel(kinds.Array3f16, lookup(kinds.Float16, level.axis))))


def _lerp(begin: Any, end: Any, part: Any) -> Any:
    return dr.fma(end - begin, part, begin)
