"""Bricks of Zarr arrays: every chunk is decoded once, and memory follows the bricks that hold matter.

Tiles are read from the far corner of the lattice backwards, and cut into bricks by threads. A tile leaves its first
layers behind for those before it, whose last bricks share them.
"""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Future
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import arrays, lookup
from hagoromo.errors import InputError, described
from hagoromo.volume.bricks import Bricks, table_shape
from hagoromo.volume.store.blocks import (
    OFFSETS,
    as_bricks,
    bricks_of,
    filled,
    kept_bricks,
    low_part,
    matter_flags,
    runs,
)
from hagoromo.volume.store.brick_writer import BrickWriter
from hagoromo.volume.store.zarr_blocks import Tile, ZarrBlocks, in_order
from hagoromo.volume.table import BLOCK
from hagoromo.volume.voxels import BRICK

BRICKS_AT_ONCE = 1 << 12  # bricks sent to the device together, or a few more
Values = dict[str, NDArray]  # by array
Layers = dict[Tile, Future[dict[tuple[int, ...], Values]]]  # what others share of a tile, by OFFSETS from them to it


def occupied_places(source: ZarrBlocks) -> NDArray[np.int32]:
    """The bricks that hold matter, (n, 3) in table order: a pass over the densities alone.

    `InputError` where all of it is too thin to be kept, a warning where much of it is.
    """

    def occupied_in(tile: Tile) -> tuple[NDArray[np.int64], NDArray[np.uint8]]:
        flags = matter_flags(filled(source.voxels(tile, only_density=True)["density"] > 0))
        held = np.argwhere(flags)
        return held + np.multiply(tile, source.tile) // BRICK, flags[tuple(held.T)]

    parts = list(in_order(occupied_in, map(tuple, source.tiles().tolist())))
    source.check_thin()
    places = np.concatenate([np.zeros((0, 3), np.int64), *(places for places, _ in parts)])
    flags = np.concatenate([np.zeros(0, np.uint8), *(flags for _, flags in parts)])
    return kept_bricks(places, flags, source.shape)


def read_bricks(source: ZarrBlocks, places: NDArray[np.integer], materials: int) -> Bricks:
    """The bricks at `places` (n, 3). materials: how many there are.

    `InputError` for what `brick_runs` and `BrickWriter` refuse.
    """
    with described(source.density.where):
        writer = BrickWriter(source.shape, places, source.colours > 0, source.material)
    for first, voxels in brick_runs(source, writer.places, materials):
        with described(source.density.where):
            writer.write(first, **voxels)
    return writer.bricks()


def brick_runs(source: ZarrBlocks, places: NDArray[np.integer], materials: int) -> Iterator[tuple[int, dict[str, Any]]]:
    """Number of the first brick, and arguments of `BrickWriter.write`, of runs of bricks; the last run first.

    places: (n, 3) in table order. `InputError` for a material number beyond `materials`, matter in a brick that is not
    in `places`, and what `ZarrBlocks` refuses.
    """
    for first, values in _gathered(_backwards(source, places)):
        if "material" in values and values["material"].max() >= materials:
            raise InputError(
                f"{source.others['material'].where} has material number {values['material'].max()}: "
                f"the box has {materials}, numbers start at 0"
            )
        yield first, _on_device(values)


def _backwards(source: ZarrBlocks, places: NDArray[np.integer]) -> Iterator[tuple[int, Values]]:
    """Number of the first brick, and the bricks, of every block that holds some; the last block first."""
    per_tile = np.array(source.tile) // BRICK
    needed = np.unique(np.concatenate([places // per_tile, source.tiles()]), axis=0)[::-1]
    order = np.lexsort((places // per_tile).T[::-1])  # stable: by tile, in table order inside each
    held, starts = runs((places // per_tile)[order])
    numbers = {tuple(tile): order[a:b] for tile, a, b in zip(held.tolist(), starts[:-1], starts[1:], strict=True)}
    layers: Layers = {tuple(tile): Future() for tile in needed.tolist()}

    def cut(tile: Tile) -> tuple[Tile, NDArray[np.int64], Values]:
        own = numbers.get(tile, np.zeros(0, np.int64))
        return tile, own, _cut(source, tile, places[own] - np.multiply(tile, per_tile), layers)

    for tile, own, bricks in in_order(cut, list(layers)):
        begins = runs(places[own] // BLOCK)[1]
        for begin, end in zip(begins[-2::-1], begins[:0:-1], strict=True):
            yield int(own[begin]), {name: values[begin:end] for name, values in bricks.items()}
        while next(iter(layers))[0] > tile[0] + 1:
            del layers[next(iter(layers))]  # all that share them are cut


def _cut(source: ZarrBlocks, tile: Tile, places: NDArray[np.integer], layers: Layers) -> Values:
    """Read a tile and cut out the bricks at `places` (n, 3), counted from its corner; leave its first layers behind.

    It waits for the layers of the tiles after it: `in_order` has begun with these before.
    """
    try:
        values = source.voxels(tile)
        _check_nothing_lost(source, tile, values["density"], places)
    except InputError as error:
        layers[tile].set_exception(error)
        raise
    layers[tile].set_result({o: {k: v[low_part(o)].copy() for k, v in values.items()} for o in OFFSETS[1:]})
    after = {}
    for offset in OFFSETS[1:]:
        following = layers.get(tuple(k + step for k, step in zip(tile, offset, strict=True)))
        after[offset] = following.result()[offset] if following else {}
    bricks = {}
    for name, array in values.items():
        wide = np.empty((*(side + 1 for side in source.tile), *array.shape[3:]), array.dtype)
        wide[tuple(map(slice, array.shape[:3]))] = array
        for offset in OFFSETS[1:]:
            beyond = (slice(n, n + 1) if k else slice(n) for n, k in zip(array.shape, offset, strict=False))
            wide[tuple(beyond)] = after[offset].get(name, 0)
        for axis, (n, k, count) in enumerate(zip(array.shape, tile, source.across, strict=False)):
            if k + 1 == count:  # beyond the lattice its last layer stands again and again
                rows = np.moveaxis(wide, axis, 0)
                rows[n:] = rows[n - 1]
        bricks[name] = bricks_of(wide, places)
    return bricks


def _check_nothing_lost(source: ZarrBlocks, tile: Tile, density: NDArray, places: NDArray[np.integer]) -> None:
    """Raises `InputError` where a tile has matter outside the bricks at `places`."""
    covered = zip(table_shape(source.shape), tile, source.tile, strict=True)
    inner = density[tuple(slice(BRICK * m - k * side) for m, k, side in covered)]
    inner = inner.view(np.uint16)  # no −0 is among them, and whole numbers are counted ten times as fast
    held = np.count_nonzero(as_bricks(filled(inner))[tuple(places.T)]) if len(places) else 0
    if np.count_nonzero(inner) != held:
        raise InputError(f"{source.density.where} holds matter where `bricks` names none: remove the array `bricks`")


def _gathered(blocks: Iterator[tuple[int, Values]]) -> Iterator[tuple[int, Values]]:
    """Blocks that follow each other, last first, put together into BRICKS_AT_ONCE bricks."""
    held: list[Values] = []
    begin = count = 0
    for first, values in blocks:
        bricks = len(values["density"])
        if held and (first + bricks != begin or count >= BRICKS_AT_ONCE):
            yield begin, _joined(held)
            held, count = [], 0
        held.append(values)
        begin, count = first, count + bricks
    if held:
        yield begin, _joined(held)


def _joined(held: list[Values]) -> Values:
    return {name: np.concatenate([values[name] for values in held[::-1]]) for name in held[0]}


def _on_device(values: Values) -> dict[str, Any]:
    """Arguments of `BrickWriter.write`: halves become floats on the device."""
    import drjit as dr

    jit = arrays()
    sent: dict[str, Any] = {
        "density": jit.Float(lookup(jit.Float16, values["density"])),
        "axis": jit.Array3f(dr.unravel(jit.Array3f16, lookup(jit.Float16, values["axis"]))),
    }
    if "body_colour" in values:
        colour = values["body_colour"]
        colour = np.concatenate([colour, np.zeros((*colour.shape[:-1], 4 - colour.shape[-1]), colour.dtype)], axis=-1)
        sent["colour"] = jit.Array4f(dr.unravel(jit.Array4f16, lookup(jit.Float16, colour)))
    if "material" in values:
        sent["material"] = lookup(jit.UInt, values["material"].astype(np.uint32))
    dr.eval(sent)  # once, for the several kernels that write them
    return sent
