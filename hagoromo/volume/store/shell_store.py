"""Shells on disk: boxes with a chart and a texel, as a Zarr v3 group of their stored bricks.

Arrays: `places` (n, 3) of the bricks [z, y, x], in table order; per brick `height` (n, 9, 9, 9), shares of the band,
`normal` (n, 9, 9, 9, 3) and `chart` (n, 9, 9, 9, 4), see `hagoromo.transport.chart`; per level k of the texel
`texel/k/density`, `texel/k/axis` and `texel/k/scale`, see `Level`. The attribute `hagoromo` holds the header, `shape`
the voxels along (z, y, x).
"""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.finite import check_finite, finite_json
from hagoromo.files.memory import require
from hagoromo.files.reading import reading
from hagoromo.files.record import decode
from hagoromo.files.zarr_arrays import ZarrArray, open_arrays
from hagoromo.volume.box import VolumeBox
from hagoromo.volume.box_header import BoxHeader
from hagoromo.volume.bricks import Shape, brick_bytes, check_shape, table_shape
from hagoromo.volume.store.brick_writer import BrickWriter
from hagoromo.volume.store.header import BoxRecord, TexelRecord, header_from_record, header_record
from hagoromo.volume.store.seal import SEALED
from hagoromo.volume.table import in_table_order
from hagoromo.volume.texel import ALL_PARTS, DIRECTIONS, OLD_NUMBERS, REFLECTED, Level, Texel, scale_from_numbers
from hagoromo.volume.voxels import STORED

BRICKS_PER_CHUNK = 512  # bricks a chunk, and sent to the device together
STORED_SHAPE = (STORED, STORED, STORED)
BRICK_ARRAYS = {"height": (np.float16, ()), "normal": (np.float16, (3,)), "chart": (np.uint32, (4,))}
LEVEL_ARRAYS = {"density": np.float16, "axis": np.float16, "scale": np.float16}


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
