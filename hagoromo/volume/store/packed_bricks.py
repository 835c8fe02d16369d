"""Packed bricks: the group `packed` of a box on disk, its stored bricks as the device holds them, for a quick opening.

Made of the arrays beside it and never more than a copy of them: it may be removed, and is passed over where its seal
shows that the arrays have changed. Arrays, in table order: `density` (bricks, 9, 9, 9), halves; `axis` (bricks, 9, 9,
9), bits; where the box has them `colour` (bricks, 9, 9, 9, 4) and `material` (bricks, 9, 9, 9).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from numpy.typing import NDArray

from hagoromo.backend import aligned, arrays
from hagoromo.errors import InputError, described
from hagoromo.files.stores import is_file
from hagoromo.files.zarr_arrays import ZarrArray, open_arrays
from hagoromo.progress import Progress, silent
from hagoromo.volume.bricks import Bricks, Grid, check_bricks
from hagoromo.volume.store.brick_writer import DENSEST, packed_voxels
from hagoromo.volume.store.open_box import OpenBox, open_box
from hagoromo.volume.store.read_bricks import brick_runs
from hagoromo.volume.store.seal import seal
from hagoromo.volume.store.zarr_blocks import in_order
from hagoromo.volume.voxels import PAIRS, STORED, paired_density, unpacked_density

FORMAT = 1
PACKED_GROUP = "packed"
BRICKS_PER_CHUNK = 512  # bricks a chunk
CODEC = {"name": "zstd", "configuration": {"level": -3, "checksum": True}}  # twice as fast to undo as level 0
PACKED_DTYPES = {"density": "float16", "axis": "int32", "colour": "float16", "material": "uint8"}
COMPONENTS = {"colour": (4,)}
BITS = {"density": np.uint16, "axis": np.int32, "colour": np.uint16, "material": np.uint8}  # read as whole numbers
LARGEST_HALF = int(np.float16(DENSEST).view(np.uint16))  # bits of the largest density: those of negative ones are above
INFINITE = 0x7C00  # bits of an infinite half; of NaN or infinity when all of them are set
Values = dict[str, NDArray]


def write_packed(folder: Path, progress: Progress = silent) -> None:
    """Write the packed bricks of the whole box in `folder`; memory follows a chunk."""
    box = open_box(folder)
    count = len(box.places)
    if not count:
        return
    group = zarr.open_group(folder / PACKED_GROUP, mode="w", zarr_format=3)
    made: dict[str, Any] = {
        name: group.create_array(
            name, shape=(count, *_voxel(name)), chunks=(min(BRICKS_PER_CHUNK, count), *_voxel(name)),
            dtype=PACKED_DTYPES[name],
            compressors=CODEC, fill_value=0, config={"write_empty_chunks": True},
            dimension_names=("brick", "z", "y", "x", "component")[: 1 + len(_voxel(name))],
        )
        for name in _names(box)
    }  # fmt: skip

    def write(chunk: tuple[int, Values]) -> int:
        begin, values = chunk
        for name, array in made.items():
            array[begin : begin + len(values[name])] = values[name]
        return begin

    for begin in in_order(write, _chunks(box)):
        progress(1.0 - begin / count)
    group.attrs.update({"format": FORMAT, "seal": seal(box.arrays.values())})  # last: what is cut off has no seal


def read_packed(box: OpenBox, needed: NDArray[np.bool_] | None = None) -> Bricks | None:
    """The stored bricks from the packed ones; None where there are none, or none of this format and these arrays.

    needed: (n,) of the stored bricks; chunks that hold none of them are not read, and their bricks left out.
    Raises `InputError` where they are damaged, hold what is no voxel, or do not fit the memory.
    """
    folder = box.folder / PACKED_GROUP
    if not is_file(folder / "zarr.json") or "bricks" not in box.arrays or not len(box.places):
        return None
    record, stored = open_arrays(folder, tuple(PACKED_DTYPES))
    if record.get("format") != FORMAT or record.get("seal") != seal(box.arrays.values()):
        return None
    names, count = _names(box), len(box.places)
    numbers = {name: _numbers(box, name, stored.get(name)) for name in names}
    size = stored["density"].grid[0]
    wanted = np.arange(-(-count // size))
    if needed is not None and all(stored[name].grid[0] == size for name in names):
        wanted = np.unique(np.flatnonzero(needed) // size)
    kept = np.concatenate([np.zeros(0, np.int64), *(np.arange(k * size, min((k + 1) * size, count)) for k in wanted)])
    with described(str(folder)):
        check_bricks(len(kept), f"{len(kept)} bricks", box.source.colours > 0, box.source.material)
    pools = {name: aligned(len(kept) * _each(name), np.uint32 if name == "density" else BITS[name]) for name in names}

    def read(chunk: tuple[str, int, int]) -> None:
        name, number, place = chunk
        begin = number * stored[name].grid[0]
        end = min(begin + stored[name].grid[0], count)
        values = stored[name].read((begin, *(0 for _ in _voxel(name))), (end, *_voxel(name)))
        bits = np.ascontiguousarray(values).view(BITS[name])
        _check_voxels(name, bits, stored[name], len(box.header.materials))
        own = pools[name][place * _each(name) : (place + end - begin) * _each(name)]
        if name == "density":
            paired_density(bits, own)
        else:
            own[:] = bits.ravel()

    if len(kept) < count:
        chunks = [(name, int(number), at * size) for name in names for at, number in enumerate(wanted)]
    else:
        chunks = [(name, number, number * stored[name].grid[0]) for name in names for number in numbers[name]]
    for _ in in_order(read, chunks):
        pass
    grids: dict[str, Any] = {name: _grid(name, pools[name], len(kept)) for name in names}
    if len(kept) == count:
        return Bricks(box.source.shape, box.places, **grids)
    return Bricks(box.source.shape, box.places[kept], **grids, whole=box.places)


def _grid(name: str, pool: NDArray, count: int) -> Grid:
    """The memory of a quantity of `count` bricks, given to Dr.Jit."""
    jit = arrays()
    if name == "colour":
        return Grid(jit.Float16(pool.view(np.float16)), _each(name), count)
    kind = {"density": jit.UInt, "axis": jit.Int, "material": jit.UInt8}[name]
    return Grid(kind(pool), _each(name), count)


def _names(box: OpenBox) -> list[str]:
    """Arrays that the packed bricks of `box` have."""
    return ["density", "axis", *["colour"] * bool(box.source.colours), *["material"] * box.source.material]


def _voxel(name: str) -> tuple[int, ...]:
    """Shape of what an array holds of a brick."""
    return (STORED, STORED, STORED, *COMPONENTS.get(name, ()))


def _each(name: str) -> int:
    """Numbers that the device keeps of a brick."""
    return PAIRS if name == "density" else math.prod(_voxel(name))


def _chunks(box: OpenBox) -> Iterator[tuple[int, Values]]:
    """First number, and values, of the bricks of every chunk, the last chunk first."""
    held: Values = {}
    for first, voxels in brick_runs(box.source, box.places, len(box.header.materials)):
        values = _as_stored(packed_voxels(**voxels)[1])
        held = {name: np.concatenate([array, *([held[name]] if held else [])]) for name, array in values.items()}
        whole = -(-first // BRICKS_PER_CHUNK) * BRICKS_PER_CHUNK
        end = first + len(held["density"])
        for begin in range(whole, end, BRICKS_PER_CHUNK):
            yield begin, {name: array[begin - first : begin - first + BRICKS_PER_CHUNK] for name, array in held.items()}
        held = {name: array[: whole - first] for name, array in held.items()}


def _as_stored(packed: dict[str, Any]) -> Values:
    values = {name: np.array(array) for name, array in packed.items()}
    halves = unpacked_density(values.pop("density"))
    return {"density": halves} | {name: array.reshape(-1, *_voxel(name)) for name, array in values.items()}


def _numbers(box: OpenBox, name: str, array: ZarrArray | None) -> range:
    """Numbers of the chunks of an array, if it is what `box` needs and all of them are there."""
    where, wanted = box.folder / PACKED_GROUP, (len(box.places), *_voxel(name))
    if (
        array is None
        or array.shape != wanted
        or array.grid[1:] != wanted[1:]
        or str(array.array.dtype) != PACKED_DTYPES[name]
    ):
        raise InputError(
            f"{where / name} is no array {PACKED_DTYPES[name]} {wanted}: remove {where}, the box is read without"
        )
    numbers = range(-(-len(box.places) // array.grid[0]))
    for number in numbers:
        if (number, *(0 for _ in _voxel(name))) not in array.files:
            raise InputError(f"chunk {number} of {array.where} is missing: remove {where}, the box is read without")
    return numbers


def _check_voxels(name: str, bits: NDArray, array: ZarrArray, materials: int) -> None:
    """Raises `InputError` for values that no voxel has; an axis is one whatever its bits."""
    bad = {
        "density": lambda: bits.max() > LARGEST_HALF,
        "axis": lambda: False,
        "colour": lambda: ((bits & INFINITE) == INFINITE).any(),
        "material": lambda: bits.max() >= materials,
    }
    if bad[name]():
        raise InputError(f"{array.where} holds what is no {name}: remove {Path(array.where).parent}")
