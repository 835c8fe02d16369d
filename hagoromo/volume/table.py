"""Brick table: places of the stored bricks of a sparse lattice, in two levels, so that its size follows their number.

`coarse`, an entry per block of 8³ bricks (C order of [z, y, x]): ≥ 0 the number of a block that holds bricks, else
−(2d + 1) with the Chebyshev distance d [blocks] to the nearest one. `fine`, 8³ entries per such block: ≥ 0 the number
of a stored brick, else −2d, d in bricks. Bricks are numbered block by block, in C order inside each.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.files.memory import require

BLOCK = 8  # bricks a side
BRICKS = BLOCK**3  # bricks of a block
BLOCKS_AT_ONCE = 1 << 13  # blocks whose distances are computed together


class BrickTable(NamedTuple):
    """coarse: int32 (bz, by, bx); fine: int32 (blocks, 512)."""

    coarse: NDArray[np.int32]
    fine: NDArray[np.int32]

    @property
    def bytes(self) -> int:
        """Memory [byte]."""
        return self.coarse.nbytes + self.fine.nbytes


def blocks_shape(bricks: tuple[int, ...]) -> tuple[int, int, int]:
    """Blocks along (z, y, x) that cover a lattice of `bricks`."""
    z, y, x = (-(-n // BLOCK) for n in bricks)
    return z, y, x


def in_table_order(places: NDArray[np.integer], bricks: tuple[int, ...]) -> NDArray[np.int32]:
    """Places (n, 3) of bricks [z, y, x] in the order in which the table numbers them; `InputError` as `table_of`."""
    _require_table(bricks)
    places = np.asarray(places, np.int32).reshape(-1, 3)
    block, inner = _numbers(places, bricks)
    return places[np.argsort(block * BRICKS + inner, kind="stable")]


def table_of(places: NDArray[np.integer], bricks: tuple[int, ...]) -> BrickTable:
    """The table of stored bricks at `places` (n, 3), in table order, on a lattice of `bricks` (z, y, x).

    `InputError` where the table of such a lattice does not fit the memory.
    """
    from scipy.ndimage import distance_transform_cdt

    shape = blocks_shape(bricks)
    _require_table(bricks)
    if not len(places):
        return BrickTable(np.full(shape, -2 * max(shape) - 1, np.int32), np.zeros((0, BRICKS), np.int32))
    block, inner = _numbers(places, bricks)
    held, number = np.unique(block, return_inverse=True)
    empty = np.ones(shape, bool)
    empty.ravel()[held] = False
    coarse = np.zeros(shape, np.int32)
    if empty.any():
        coarse = -2 * np.asarray(distance_transform_cdt(empty, metric="chessboard"), np.int32) - 1
    coarse.ravel()[held] = np.arange(len(held), dtype=np.int32)
    kept = np.zeros((len(held), BRICKS), bool)
    kept[number, inner] = True
    fine = np.empty((len(held), BRICKS), np.int32)
    for some, distance in _distances(kept, coarse, held):
        fine[some] = -2 * distance
    fine[number, inner] = np.arange(len(places), dtype=np.int32)
    return BrickTable(coarse, fine)


def _require_table(bricks: tuple[int, ...]) -> None:
    require(8 * math.prod(blocks_shape(bricks)), f"the table of a lattice of {bricks[::-1]} bricks")


def _numbers(places: NDArray[np.integer], bricks: tuple[int, ...]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Number of the block in C order, and of the brick in its block."""
    places = places.astype(np.int64)
    outer, inner = places // BLOCK, places % BLOCK
    block = np.ravel_multi_index((outer[:, 0], outer[:, 1], outer[:, 2]), blocks_shape(bricks))
    return block, (inner[:, 0] * BLOCK + inner[:, 1]) * BLOCK + inner[:, 2]


def _distances(
    kept: NDArray[np.bool_], coarse: NDArray[np.int32], held: NDArray[np.int64]
) -> Iterator[tuple[slice, NDArray[np.int32]]]:
    """Chebyshev distance [bricks] from every brick of the held blocks to the nearest stored one: slice, (…, 512).

    Rows of bricks along x are bits of a number. A block and its neighbours are widened by one brick, eight times.
    """
    rows = np.packbits(kept.reshape(-1, BLOCK, BLOCK, BLOCK), axis=-1, bitorder="little")[..., 0]
    rows = np.concatenate([rows, np.zeros((1, BLOCK, BLOCK), np.uint8)])  # the last: an empty block
    places = np.stack(np.unravel_index(held, coarse.shape), axis=-1)
    around = np.pad(coarse, 1, constant_values=-1)
    for start in range(0, len(held), BLOCKS_AT_ONCE):
        here = places[start : start + BLOCKS_AT_ONCE]
        window = np.zeros((len(here), 3 * BLOCK, 3 * BLOCK), np.uint32)
        for z, y, x in np.ndindex(3, 3, 3):
            block = around[here[:, 0] + z, here[:, 1] + y, here[:, 2] + x]
            bits = rows[np.where(block < 0, -1, block)].astype(np.uint32) << np.uint32(BLOCK * x)
            window[:, BLOCK * z : BLOCK * (z + 1), BLOCK * y : BLOCK * (y + 1)] |= bits
        distance = np.zeros((len(here), BLOCK, BLOCK, BLOCK), np.int32)
        for _ in range(BLOCK):
            middle = (window[:, BLOCK : 2 * BLOCK, BLOCK : 2 * BLOCK] >> np.uint32(BLOCK)).astype(np.uint8)
            distance += np.unpackbits(~middle[..., None], axis=-1, bitorder="little")
            window |= window << np.uint32(1) | window >> np.uint32(1)
            for rows_of in (window, window.swapaxes(1, 2)):
                wide = rows_of.copy()
                wide[:, 1:] |= rows_of[:, :-1]
                wide[:, :-1] |= rows_of[:, 1:]
                rows_of[...] = wide
        yield slice(start, start + len(here)), distance.reshape(-1, BRICKS)
