"""Blocks: cubes of 8³ bricks (64³ voxels), the pieces in which a lattice is stored, built and read.

Arrays of a block are indexed [z, y, x, …]. A brick is stored when any of its 9³ voxels holds matter, and the last layer
of these is the first of the next brick: so a block notes, per brick, which of its low faces, edges and corner hold
matter, and bricks are chosen when all blocks are known.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from hagoromo.volume.bricks import table_shape
from hagoromo.volume.table import BLOCK, in_table_order
from hagoromo.volume.voxels import BRICK, STORED

BLOCK_SIDE = BLOCK * BRICK  # voxels
Block = tuple[int, int, int]  # [z, y, x in blocks]
OFFSETS = tuple(product((0, 1), repeat=3))  # from a brick or block to those whose first layer it shares; itself first


def low_part(offset: tuple[int, ...]) -> tuple[slice, ...]:
    """What a block (or brick) shares with the one that lies `offset` before it: its first layer, edge or voxel."""
    return tuple(slice(0, 1) if step else slice(None) for step in offset)


def matter_flags(matter: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Per brick of a block, or of any whole number of bricks: bit k is set where `low_part(OFFSETS[k])` has matter."""
    z, y, x = (n // BRICK for n in matter.shape)
    bricks = matter.reshape(z, BRICK, y, BRICK, x, BRICK).transpose(0, 2, 4, 1, 3, 5)
    flags = np.zeros((z, y, x), np.uint8)
    for bit, offset in enumerate(OFFSETS):
        flags |= bricks[(..., *low_part(offset))].any(axis=(3, 4, 5)).astype(np.uint8) << np.uint8(bit)
    return flags


def kept_bricks(
    places: NDArray[np.integer], flags: NDArray[np.uint8], shape: tuple[int, int, int]
) -> NDArray[np.int32]:
    """Bricks to keep on a lattice of `shape`, in table order, from the flags (n) of those at places (n, 3)."""
    lattice = table_shape(shape)
    kept = [places[(flags >> bit) & 1 == 1] - offset for bit, offset in enumerate(OFFSETS)]
    places = np.concatenate(kept)
    places = places[((places >= 0) & (places < lattice)).all(axis=1)]
    numbers = np.unique(np.ravel_multi_index(tuple(places.T), lattice))
    return in_table_order(np.stack(np.unravel_index(numbers, lattice), axis=-1), lattice)


def runs(blocks: NDArray[np.integer]) -> tuple[NDArray[np.integer], NDArray[np.int64]]:
    """Distinct rows of `blocks` (n, 3), equal ones being neighbours, where each begins, and n after the last."""
    begin = np.flatnonzero((np.diff(blocks, axis=0, prepend=-1) != 0).any(axis=1))
    return blocks[begin], np.append(begin, len(blocks))


def filled(values: NDArray) -> NDArray:
    """`values` (z, y, x) with zeros at the end of each axis up to whole bricks."""
    missing = [(0, -n % BRICK) for n in values.shape]
    return np.pad(values, missing) if any(after for _, after in missing) else values


def as_bricks(values: NDArray) -> NDArray:
    """A view of whole bricks (8 a, 8 b, 8 c, …) as (a, b, c, 8, 8, 8, …)."""
    parts = values.reshape(*(size for n in values.shape[:3] for size in (n // BRICK, BRICK)), *values.shape[3:])
    return parts.transpose(0, 2, 4, 1, 3, 5, *range(6, parts.ndim))


def bricks_of(block: NDArray, places: NDArray[np.integer]) -> NDArray:
    """The bricks (k, 9, 9, 9, …) at `places` (k, 3) in whole bricks that carry the next layer: (8 n + 1, …)."""
    bricks = _windows(block)[tuple(places.T)]
    return bricks.view(block.dtype).reshape(-1, STORED, STORED, STORED, *block.shape[3:])


def block_of(bricks: NDArray, places: NDArray[np.integer]) -> NDArray:
    """The block (65, 65, 65, …) that carries the next layer, of bricks (k, 9, 9, 9, …) at `places`; 0 elsewhere."""
    block = np.zeros((BLOCK_SIDE + 1,) * 3 + bricks.shape[4:], bricks.dtype)
    _windows(block)[tuple(places.T)] = _packets(bricks, 4)
    return block


def _windows(block: NDArray) -> NDArray:
    """Views of the bricks of a block: (8, 8, 8, 9, 9, 9), the components of a voxel as one."""
    windows = np.lib.stride_tricks.sliding_window_view(_packets(block, 3), (STORED,) * 3, writeable=True)
    return windows[::BRICK, ::BRICK, ::BRICK]


def _packets(values: NDArray, axes: int) -> NDArray:
    """`values` with all that a voxel holds, from axis number `axes` on, as one value; a view where it can be."""
    packet = np.dtype((np.void, values.itemsize * int(np.prod(values.shape[axes:]))))
    return np.ascontiguousarray(values).reshape(*values.shape[:axes], -1).view(packet)[..., 0]
