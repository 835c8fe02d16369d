"""Open box: a volume box on disk whose header and index are read and checked, and whose voxels are not read yet."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.stores import is_file
from hagoromo.files.zarr_arrays import ZarrArray, open_arrays
from hagoromo.volume.box_header import BoxHeader
from hagoromo.volume.bricks import table_shape
from hagoromo.volume.store.blocks import BLOCK_SIDE, runs
from hagoromo.volume.store.header import header_from_record
from hagoromo.volume.store.read_bricks import occupied_places
from hagoromo.volume.store.zarr_blocks import ZarrBlocks
from hagoromo.volume.table import BLOCK, in_table_order

ARRAYS = ("density", "axis", "body_colour", "material", "bricks")


class OpenBox(NamedTuple):
    """The Zarr group in `folder`: header, voxels, stored bricks (n, 3) in table order, and all its arrays by name."""

    folder: Path
    header: BoxHeader
    source: ZarrBlocks
    places: NDArray[np.int32]
    arrays: dict[str, ZarrArray]


def open_box(path: str | Path) -> OpenBox:
    """The box in the Zarr group at `path`; `InputError` when it is missing, damaged or foreign."""
    folder = Path(path)
    if not is_file(folder / "zarr.json"):
        raise InputError(f"{folder} is no volume box: give a Zarr v3 group that `hagoromo build` wrote")
    attributes, arrays = open_arrays(folder, ARRAYS)
    header = header_from_record(attributes.get("hagoromo"), str(folder))
    if "density" not in arrays or ("bricks" in arrays and "axis" not in arrays):
        raise InputError(f"{folder} lacks the array {'axis' if 'density' in arrays else 'density'!r}: it is damaged")
    others = {name: array for name, array in arrays.items() if name not in ("density", "bricks")}
    source = ZarrBlocks(arrays["density"], others)
    if source.colours not in (0, max(len(header.basis), 1)):
        raise InputError(f"{folder}: body_colour has {source.colours} components, basis {len(header.basis)} spectra")
    places = _stored_places(arrays["bricks"], source) if "bricks" in arrays else occupied_places(source)
    return OpenBox(folder, header, source, places, arrays)


def _stored_places(bricks: ZarrArray, source: ZarrBlocks) -> NDArray[np.int32]:
    """The stored bricks that `bricks` names, (n, 3) in table order; every block that holds some has its chunks."""
    lattice = table_shape(source.shape)
    if bricks.shape != lattice:
        raise InputError(f"{bricks.where} is {bricks.shape}: density {source.shape} needs {lattice}")
    places_of_tiles = [np.zeros((0, 3), np.int64)]
    for index in bricks.files:
        low = tuple(k * size for k, size in zip(index, bricks.grid, strict=True))
        high = tuple(min(a + size, n) for a, size, n in zip(low, bricks.grid, lattice, strict=True))
        places_of_tiles.append(np.argwhere(bricks.read(low, high)) + low)
    places = in_table_order(np.concatenate(places_of_tiles), lattice)
    blocks = runs(places // BLOCK)[0].tolist()
    for array in (source.density, *source.others.values()):
        if array.grid[:3] == tuple(min(BLOCK_SIDE, n) for n in source.shape):
            _check_chunks(array, blocks)
    return places


def _check_chunks(array: ZarrArray, blocks: list[list[int]]) -> None:
    for block in blocks:
        index = (*block, *(0 for _ in array.shape[3:]))
        if index not in array.files:
            key = array.array.metadata.encode_chunk_key(index)
            raise InputError(f"{array.where}/{key} is missing, and `bricks` says that it holds matter: build it again")
