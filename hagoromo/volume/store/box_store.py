"""Volume boxes on disk: a Zarr v3 group that any Zarr reader opens; `box_group` says what is in it.

Shells on disk: boxes with a chart and a texel, as a Zarr v3 group of their stored bricks.

Arrays: `places` (n, 3) of the bricks [z, y, x], in table order; per brick `height` (n, 9, 9, 9), shares of the band,
`normal` (n, 9, 9, 9, 3) and `chart` (n, 9, 9, 9, 4), see `hagoromo.transport.chart`; per level k of the texel
`texel/k/density`, `texel/k/axis` and `texel/k/scale`, see `Level`. The attribute `hagoromo` holds the header, `shape`
the voxels along (z, y, x).
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import zarr
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.finite import check_finite, finite_json
from hagoromo.files.memory import require
from hagoromo.files.reading import reading
from hagoromo.files.record import decode
from hagoromo.files.stores import is_file
from hagoromo.files.whole import whole_folder
from hagoromo.files.zarr_arrays import ZarrArray, open_arrays
from hagoromo.volume.box import VolumeBox
from hagoromo.volume.box_header import BoxHeader
from hagoromo.volume.bricks import Bricks, Shape, brick_bytes, check_shape, table_shape
from hagoromo.volume.store.blocks import BLOCK_SIDE, OFFSETS, Block, block_of, low_part, runs
from hagoromo.volume.store.box_group import BoxGroup
from hagoromo.volume.store.brick_writer import BrickWriter
from hagoromo.volume.store.header import BoxRecord, TexelRecord, header_from_record, header_record
from hagoromo.volume.store.open_box import OpenBox, open_box
from hagoromo.volume.store.packed_bricks import read_packed, write_packed
from hagoromo.volume.store.read_bricks import read_bricks
from hagoromo.volume.store.seal import SEALED
from hagoromo.volume.table import BLOCK, in_table_order
from hagoromo.volume.texel import ALL_PARTS, DIRECTIONS, OLD_NUMBERS, REFLECTED, Level, Texel, scale_from_numbers
from hagoromo.volume.voxels import STORED

BRICKS_PER_CHUNK = 512  # bricks a chunk, and sent to the device together
STORED_SHAPE = (STORED, STORED, STORED)
BRICK_ARRAYS = {"height": (np.float16, ()), "normal": (np.float16, (3,)), "chart": (np.uint32, (4,))}
LEVEL_ARRAYS = {"density": np.float16, "axis": np.float16, "scale": np.float16}


def save_box(box: VolumeBox, path: str | Path, force: bool = False) -> None:
    """Write `box` as a Zarr v3 group at `path`, whole or not at all; loaded again it has the same bits.

    force: replace what is there; without it an existing `path` is an `InputError`.
    """
    colours = max(len(box.basis), 1) if box.bricks.colour is not None else 0
    with whole_folder(path, force) as folder:
        if box.texel:
            write_shell(box, folder)
            return
        group = BoxGroup(folder, box.bricks.shape, box.header, colours, box.bricks.material is not None)
        for block, values in _blocks(box, colours):
            group.write(block, values)
        group.finish(box.bricks.places)
        write_packed(folder)


def load_box(path: str | Path) -> VolumeBox:
    """The volume box in the Zarr group at `path`; `InputError` when it is missing, damaged, foreign or too large."""
    if holds_shell(path):
        return read_shell(Path(path))
    box = open_box(path)
    return VolumeBox.of(box.header, stored_bricks(box))


def stored_bricks(box: OpenBox, needed: NDArray[np.bool_] | None = None) -> Bricks:
    """The bricks of a box on disk; of packed ones, those `needed` (n,) at least. `InputError` as from `load_box`."""
    return read_packed(box, needed) or read_bricks(box.source, box.places, len(box.header.materials))


class StoredBox(NamedTuple):
    """A summary of a box on disk, without reading its voxels: shape (nz, ny, nx), bricks that hold matter, memory."""

    header: BoxHeader
    shape: tuple[int, int, int]
    kept: int
    bytes: int

    def __str__(self) -> str:
        voxels = " × ".join(map(str, self.shape[::-1]))
        memory = f"{self.kept} bricks, {self.bytes / 2**20:.1f} MiB, of them hold matter"
        return f"{voxels} voxels of {1000 * self.header.voxel_size:.3g} mm, {memory}"


def look_at_box(path: str | Path) -> StoredBox:
    """The box in the Zarr group at `path`, its voxels unread; `InputError` as from `load_box`."""
    if holds_shell(path):
        return StoredBox(*look_at_shell(Path(path)))
    box = open_box(path)
    size = brick_bytes(box.source.colours > 0, box.source.material)
    return StoredBox(box.header, box.source.shape, len(box.places), len(box.places) * size)


def holds_shell(path: str | Path) -> bool:
    """Whether a box is a shell around a texel."""
    return is_file(Path(path) / "zarr.json") and is_shell(open_arrays(path)[0].get("hagoromo"))


def _blocks(box: VolumeBox, colours: int) -> Iterator[tuple[Block, dict[str, NDArray]]]:
    """Every block (64, 64, 64, …) of `box` in which a stored brick has voxels.

    The last layer of a stored brick may be the first of a brick, or of a block, that is not stored.
    """
    blocks, starts = runs(box.bricks.places // BLOCK)
    shared: dict[Block, list[tuple[Block, dict[str, NDArray]]]] = {}
    for block, begin, end in zip(blocks.tolist(), starts[:-1], starts[1:], strict=True):
        z, y, x = block
        held = box.bricks.read(begin, end)
        if "colour" in held:
            held["body_colour"] = held.pop("colour")[..., :colours]
        inner = box.bricks.places[begin:end] % BLOCK
        wide = {name: block_of(values, inner) for name, values in held.items()}
        for a, b, c in OFFSETS[1:]:
            beyond = tuple(slice(BLOCK_SIDE, None) if step else slice(BLOCK_SIDE) for step in (a, b, c))
            part = {name: values[beyond].copy() for name, values in wide.items()}
            if any(values.any() for values in part.values()):
                shared.setdefault((z + a, y + b, x + c), []).append(((a, b, c), part))
        own = {name: values[:BLOCK_SIDE, :BLOCK_SIDE, :BLOCK_SIDE] for name, values in wide.items()}
        yield (z, y, x), _with_shared(own, shared.pop((z, y, x), []))
    for block, parts in shared.items():
        if all(BLOCK_SIDE * k < n for k, n in zip(block, box.bricks.shape, strict=True)):
            own = {
                name: np.zeros((BLOCK_SIDE,) * 3 + values.shape[3:], values.dtype)
                for name, values in parts[0][1].items()
            }
            yield block, _with_shared(own, parts)


def _with_shared(own: dict[str, NDArray], parts: list[tuple[Block, dict[str, NDArray]]]) -> dict[str, NDArray]:
    for offset, part in parts:
        for name, values in part.items():
            first = own[name][low_part(offset)]
            first[...] = np.where(first == 0, values, first)
    return own


def write_shell(box: VolumeBox, folder: Path) -> None:
    """Write the shell `box` into an empty folder."""
    assert box.texel is not None
    group = zarr.open_group(folder, mode="w", zarr_format=3)
    group.attrs["hagoromo"] = json.loads(finite_json(header_record(box), str(folder)))
    group.attrs["shape"] = list(box.bricks.shape)
    total = max(box.bricks.kept, 1)
    made: dict[str, Any] = {
        name: group.create_array(
            name, shape=(total, *STORED_SHAPE, *more), chunks=(min(BRICKS_PER_CHUNK, total), *STORED_SHAPE, *more),
            dtype=kind,
            compressors=SEALED, fill_value=0,
        )
        for name, (kind, more) in BRICK_ARRAYS.items()
    }  # fmt: skip
    for begin in range(0, box.bricks.kept, BRICKS_PER_CHUNK):
        end = min(begin + BRICKS_PER_CHUNK, box.bricks.kept)
        held = box.bricks.read(begin, end)
        check_finite(held, str(folder), "numbers")
        made["height"][begin:end], made["normal"][begin:end] = held["density"], held["axis"]
        made["chart"][begin:end] = held["chart"]
    group.create_array("places", data=box.bricks.places.astype(np.int32), compressors=SEALED)
    for k, level in enumerate(box.texel.levels):
        part = group.create_group(f"texel/{k}")
        for name in LEVEL_ARRAYS:
            part.create_array(name, data=getattr(level, name), compressors=SEALED)


def is_shell(record: Any) -> bool:
    """Whether the attribute `hagoromo` of a group says that a texel is in it."""
    return isinstance(record, dict) and "texel" in record


def look_at_shell(folder: Path) -> tuple[BoxHeader, Shape, int, int]:
    """Header, shape, number of bricks and memory [byte] of a shell, its voxels unread."""
    record, shape, numbers, stored = _opened(folder)
    kept = stored["places"].shape[0]
    levels = sum(8 * int(np.prod(stored[f"texel/{k}/density"].shape)) for k in range(numbers.levels))
    return header_from_record(record, str(folder)), shape, kept, kept * brick_bytes(chart=True) + levels


def read_shell(folder: Path) -> VolumeBox:
    """The shell in `folder`; `InputError` where it is damaged, foreign or does not fit the memory."""
    record, shape, numbers, stored = _opened(folder)
    header = header_from_record(record, str(folder))
    places = _whole(stored["places"], np.int32, (None, 3))
    lattice = table_shape(shape)
    if len(places) and ((places < 0) | (places >= lattice)).any():
        raise InputError(f"{folder}/places names bricks outside the lattice of {lattice[::-1]}: the box is damaged")
    if not np.array_equal(places, in_table_order(places, lattice)) or len(np.unique(places, axis=0)) != len(places):
        raise InputError(f"{folder}/places is not in the order of bricks: the box is damaged")
    writer = BrickWriter(shape, places, chart=True)
    for name, (kind, more) in BRICK_ARRAYS.items():
        _check(stored[name], kind, (max(len(places), 1), *STORED_SHAPE, *more))
    for begin in range(0, len(places), BRICKS_PER_CHUNK):
        end = min(begin + BRICKS_PER_CHUNK, len(places))
        height, normal, words = (
            stored[name].read((begin, *[0] * (3 + len(more))), (end, *STORED_SHAPE, *more))
            for name, (_, more) in BRICK_ARRAYS.items()
        )
        writer.write(begin, height.astype(np.float32), normal.astype(np.float32), chart=words)
    levels = tuple(_level(stored, k, str(folder)) for k in range(numbers.levels))
    if len({len(level.density) for level in levels}) != 1:
        raise InputError(f"{folder}: the levels of the texel differ in their populations: the box is damaged")
    texel = Texel(numbers.period, numbers.bottom, numbers.top, numbers.variants, levels)
    for k, level in enumerate(levels):
        if (level.nodes[1] - 1) % texel.variants or min(level.nodes) < 2 or level.nodes[1] <= texel.variants:
            raise InputError(f"{folder}/texel/{k}: {level.nodes} nodes do not hold {texel.variants} variants")
    return VolumeBox.of(replace(header, texel=texel), writer.bricks())


def _opened(folder: Path) -> tuple[Any, Shape, TexelRecord, dict[str, ZarrArray]]:
    """Attribute `hagoromo`, shape of the lattice, numbers of the texel, and all arrays that they say are there."""
    attributes, where = open_arrays(folder)[0], str(folder)
    record = attributes.get("hagoromo")
    numbers = decode(record, BoxRecord, where).texel
    if numbers is None:
        raise InputError(f"{where} has no texel: it is no shell")
    names = ["places", *BRICK_ARRAYS, *(f"texel/{k}/{name}" for k in range(numbers.levels) for name in LEVEL_ARRAYS)]
    stored = open_arrays(folder, tuple(names))[1]
    for name in names:
        if name not in stored:
            raise InputError(f"{folder} lacks the array {name!r}: it is damaged, build it again")
    return record, _shape(attributes.get("shape"), where), numbers, stored


def _shape(given: Any, where: str) -> Shape:
    if not (isinstance(given, list) and len(given) == 3 and all(type(n) is int for n in given)):
        raise InputError(f"{where} has shape {given!r}: the box is damaged")
    shape = given[0], given[1], given[2]
    check_shape(shape)
    return shape


def _level(stored: dict[str, ZarrArray], k: int, where: str) -> Level:
    populations = stored[f"texel/{k}/density"].shape[0] if stored[f"texel/{k}/density"].shape else 0
    density = _whole(stored[f"texel/{k}/density"], np.float16, (populations, None, None, None))
    axis = _whole(stored[f"texel/{k}/axis"], np.float16, (*density.shape, 3))
    scale = _scale(stored[f"texel/{k}/scale"], populations)
    if not (np.isfinite(density).all() and np.isfinite(axis).all() and np.isfinite(scale).all()):
        raise InputError(f"{where}/texel/{k} holds numbers that are not finite: the box is damaged")
    if density.min(initial=0) < 0:
        raise InputError(f"{where}/texel/{k}/density goes below 0: the box is damaged")
    return Level(density, axis, scale)


def _scale(array: ZarrArray, populations: int) -> NDArray[np.float16]:
    """The scale of a level; a box of version 0.2 has numbers in place of a table."""
    if len(array.shape) == 3:
        return scale_from_numbers(_whole(array, np.float32, (populations, 2, OLD_NUMBERS)))
    parts = ALL_PARTS if array.shape[1:2] == (ALL_PARTS,) else REFLECTED
    return _whole(array, np.float16, (populations, parts, DIRECTIONS, DIRECTIONS))


def _whole(array: ZarrArray, kind: Any, shape: tuple[int | None, ...]) -> NDArray:
    """All numbers of an array of that type and shape (None: any)."""
    _check(array, kind, shape)
    require(math.prod(array.shape) * np.dtype(kind).itemsize, array.where)
    with reading(array.where, "an array"):
        return np.asarray(array.array[...])


def _check(array: ZarrArray, kind: Any, shape: tuple[int | None, ...]) -> None:
    fits = len(array.shape) == len(shape) and all(b in (None, a) for a, b in zip(array.shape, shape, strict=True))
    if not fits or array.array.dtype != kind:
        wanted = tuple("any" if n is None else n for n in shape)
        raise InputError(f"{array.where} is {array.array.dtype} {array.shape}: {np.dtype(kind)} {wanted} is wanted")
