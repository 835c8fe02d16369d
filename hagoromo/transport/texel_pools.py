"""Texel pools: the levels of texels packed for kernels. Enters: texels. Leaves: flat arrays on the device."""

from __future__ import annotations

import weakref
from collections.abc import Sequence
from typing import Any

import drjit as dr
import numpy as np

from hagoromo.backend import Int, UInt, aligned, arrays, check_entries, lookup
from hagoromo.files.memory import require
from hagoromo.volume.texel import DIRECTIONS, Level, Texel
from hagoromo.volume.voxels import SMALLEST_DENSITY, packed_axis

NODES_AT_ONCE = 1 << 18  # of a level, that are packed together


class TexelPools:
    """The levels of some texels, one after the other: rows of numbers of each, densities, axes and scales of light.

    See `Textures`, which reads them.
    """

    def __init__(self, texels: Sequence[Texel]) -> None:
        jit, what = arrays(), "the texels of all boxes together"
        levels = [level for texel in texels for level in texel.levels]
        count = sum(_entries(level) for level in levels)
        check_entries(count, what)
        require(8 * count, what)
        offsets = np.cumsum([0, *map(_entries, levels)])
        rows = [_level_row(texel, level) for texel in texels for level in texel.levels]
        words = np.array([(offset, *row) for offset, row in zip(offsets, rows, strict=False)], np.uint32)
        axes = np.cumsum([0, *(level.density.size for level in levels)])
        populations, parts = (max(numbers) for numbers in zip(*((t.populations, t.parts) for t in texels), strict=True))
        scale = np.zeros((len(levels), populations, DIRECTIONS, DIRECTIONS, parts), np.float32)
        for row, level in zip(scale, levels, strict=True):
            row[: len(level.scale), ..., : level.scale.shape[1]] = np.moveaxis(level.scale, 1, -1)
        self.rows, self.scale = lookup(jit.UInt, words), lookup(jit.Float, scale)
        self.axes_behind = lookup(jit.UInt, (axes - offsets)[:-1].astype(np.uint32))
        self.densities, self.axes = _densities_pool(levels, count), _axes_pool(levels)
        dr.eval(self.rows, self.scale, self.axes_behind, self.densities, self.axes)


_kept: weakref.WeakKeyDictionary[Texel, tuple[tuple[Any, ...], TexelPools]] = weakref.WeakKeyDictionary()


def pools_of(texels: Sequence[Texel]) -> TexelPools:
    """The pools of some texels, packed once and kept as long as the first of them is there."""
    key = (arrays().Float, *map(weakref.ref, texels))
    known = _kept.pop(texels[0], None)
    pools = known[1] if known is not None and known[0] == key else None
    del known  # before others are packed: no two are in memory
    _kept[texels[0]] = key, pools or TexelPools(texels)
    return _kept[texels[0]][1]


def _level_row(texel: Texel, level: Level) -> tuple[int, int, int]:
    """Nodes along u, nodes along h, and nodes along v with cells of a period along u above them."""
    v, u, h = level.nodes
    check_entries(max(v, u // texel.variants) << 16, "a side of a texel")
    return u, h, v | (texel.cells(level)[0] << 16)


def _entries(level: Level) -> int:
    """Of a level in the pools: all populations together, then each."""
    return level.density.size // len(level.density) * (len(level.density) + 1)


def _densities_pool(levels: Sequence[Level], count: int) -> UInt:
    """Densities as halves, each with the next above it, of all levels; filled some rows at a time."""
    pool, start = aligned(count, np.uint32), 0
    for level in levels:
        for rows in _rows(level):
            density = level.density[:, rows]
            total = density.sum(axis=0, dtype=np.float32).astype(np.float16)
            for number, values in enumerate((total, *density)):
                halves = np.where(values < SMALLEST_DENSITY, np.float16(0), values).view(np.uint16)
                first = start + (number * level.nodes[0] + rows.start) * values[0].size
                pairs = pool[first : first + values.size].reshape(values.shape)
                pairs[...] = halves
                pairs[..., :-1] |= halves[..., 1:].astype(np.uint32) << np.uint32(16)
        start += _entries(level)
    return arrays().UInt(pool)


def _axes_pool(levels: Sequence[Level]) -> Int:
    """Packed axes of all levels, population by population."""
    jit = arrays()
    pool, start = dr.zeros(jit.Int, max(sum(level.density.size for level in levels), 2)), 0
    for level in levels:
        for values in level.axis:
            for rows in _rows(level):
                axis = packed_axis(jit.Array3f(dr.unravel(jit.Array3f16, lookup(jit.Float16, values[rows]))))
                dr.scatter(pool, axis, dr.arange(jit.UInt, dr.width(axis)) + dr.opaque(jit.UInt, start))
                dr.eval(pool)
                dr.sync_thread()  # the memory of rows that wait for the device adds up
                start += dr.width(axis)
    return pool


def _rows(level: Level) -> list[slice]:
    """Rows along v of about NODES_AT_ONCE nodes of a population."""
    v, u, h = level.nodes
    step = max(NODES_AT_ONCE // (u * h), 1)
    return [slice(begin, min(begin + step, v)) for begin in range(0, v, step)]
