"""NanoVDB (.nvdb): grids of OpenVDB as one block of memory each, plain or packed. Lengths are metres.

The places of bytes are those of NanoVDB's `NanoVDB.h` and `io/IO.h`, version 32 (OpenVDB 9 to 13).
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.apart import Arrays
from hagoromo.files.checks import PACKED, check_density, existing_file, read_bytes
from hagoromo.files.format import file_and_part
from hagoromo.files.memory import require
from hagoromo.files.reading import reading
from hagoromo.files.volume_file import VolumeFile
from hagoromo_formats.volumes.apart_volume import as_arrays, whole_apart
from hagoromo_formats.volumes.openvdb import MOST_GRIDS, NODES, Bytes
from hagoromo_formats.volumes.sparse_lattice import LEAF, LEVEL_SET, SparseLattice, chosen

MAGICS, VERSION = (b"NanoVDB0", b"NanoVDB2"), 32
TYPES = {1: ("<f4", 1), 2: ("<f8", 1), 4: ("<i4", 1), 5: ("<i8", 1), 6: ("<f4", 3), 7: ("<f8", 3)}
TYPE_NAMES = "float, double, int32, int64, vec3f, vec3d"
USES = {1: LEVEL_SET}
GRID, TREE = 672, 64  # bytes of the heads of a grid and its tree
MATRIX, USE, TYPE = 296 + 88, 632, 636  # where the head of a grid has its map in doubles, its class and its type
ALIGNED = 32  # bytes
KEY_BITS = 21  # of a coordinate in the key of a tile of the root
PLAIN, ZIPPED, BLOSC = 0, 1, 2


class Entry(NamedTuple):
    """A grid of a file: bytes of it, whether they are packed, where they begin."""

    size: int
    codec: int
    start: int
    packed: int


def read_nanovdb(path: str | Path) -> VolumeFile:
    """A grid of a .nvdb: its only one, the one called density, or the one named behind a colon: smoke.nvdb:flame.

    Read in a process apart. `InputError` for a level set, numbers in fewer bits than a half float, and what is damaged
    or too large.
    """
    file, wanted = file_and_part(path)
    return whole_apart(existing_file(file), "NanoVDB", dense_nanovdb, wanted)


def dense_nanovdb(file: Path, wanted: str) -> Arrays:
    """The values and the matrix of a grid; run by `read_apart`."""
    source, where = Bytes(memoryview(read_bytes(file, growth=3.0))), f"{file}:{wanted}" if wanted else str(file)
    with reading(file, "NanoVDB"):
        lattice = _lattice(_block(source, chosen(_entries(source, str(file)), wanted, str(file)), file), where)
    return as_arrays(lattice.dense(where, file))


def _entries(source: Bytes, where: str) -> dict[str, Entry]:
    """The grids by their names, over all segments of the file."""
    found: dict[str, Entry] = {}
    while source.at < len(source.data):
        magic, version, count, codec = bytes(source.take(8)), *source.numbers("IHH")
        if magic not in MAGICS or version >> 21 != VERSION:
            raise InputError(f"{where} is no NanoVDB of version {VERSION}: write it anew by OpenVDB 9 or later")
        rows = []
        for _ in range(count):
            size, packed = source.numbers("QQ")
            source.take(136 - 16)
            (length,) = source.numbers("I")
            source.take(176 - 140)
            rows.append((bytes(source.take(length)).rstrip(b"\0").decode("utf-8", "replace"), size, packed))
        for name, size, packed in rows:
            found.setdefault(name, Entry(size, codec, source.at, packed))
            source.take(packed)
        if len(found) > MOST_GRIDS:
            raise InputError(f"{where} has more than {MOST_GRIDS} grids: write the one you need")
    return found


def _block(source: Bytes, entry: Entry, where: Path) -> memoryview:
    """The bytes of a grid, unpacked."""
    from hagoromo.files.zarr_codecs import unpacked

    check_density(entry.size, where, PACKED, f"a grid of {entry.size} bytes")
    require(3.0 * entry.size, str(where))
    held = Bytes(source.data[entry.start : entry.start + entry.packed])
    if entry.codec == PLAIN:
        return held.take(entry.size)
    if entry.codec not in (ZIPPED, BLOSC):
        raise InputError(f"{where} is packed by codec {entry.codec}: none, zip and blosc are read")
    parts: list[bytes] = []
    while (left := entry.size - sum(map(len, parts))) > 0:
        data = bytes(held.take(held.numbers("Q")[0]))
        parts.append(bytes(unpacked("zlib" if entry.codec == ZIPPED else "blosc", data, left, False, {})))
        if not parts[-1]:
            raise ValueError("its packed bytes are cut off")
    return memoryview(b"".join(parts))


def _lattice(data: memoryview, where: str) -> SparseLattice:
    kind, use = struct.unpack_from("<I", data, TYPE)[0], struct.unpack_from("<I", data, USE)[0]
    if kind not in TYPES:
        raise InputError(f"{where} holds numbers of type {kind}: {TYPE_NAMES} are read")
    stored, components = np.dtype(TYPES[kind][0]), TYPES[kind][1]
    matrix = np.eye(4)
    matrix[:3, :3] = np.frombuffer(data, "<f8", 9, MATRIX).reshape(3, 3)
    matrix[:3, 3] = np.frombuffer(data, "<f8", 3, MATRIX + 144)
    to_leaf, to_lower, to_upper, to_root, leaves, lowers, uppers = struct.unpack_from("<4q3I", data, GRID)
    value = np.dtype((stored, (components,)) if components > 1 else stored)
    root = GRID + to_root
    background = np.frombuffer(data, stored, components, root + 28)
    single = components == 1
    lattice = SparseLattice(where, USES.get(use, ""), stored, components, background[0] if single else background,
                            matrix)  # fmt: skip
    _root_tiles(data, root, value, lattice)
    for offset, count, (edge, width) in ((to_upper, uppers, NODES[0]), (to_lower, lowers, NODES[1])):
        for node in _table(data, GRID + offset, count, _node_type(edge, value)):
            active = _bits(node["active"]) & ~_bits(node["child"])
            first = node["first"].astype(np.int64) & ~(edge * width - 1)
            for k in np.flatnonzero(active):
                place = first + np.array(np.unravel_index(k, (edge,) * 3)) * width
                lattice.tiles.append((place, width, node["table"]["value"][k]))
    for node in _table(data, GRID + to_leaf, leaves, _leaf_type(value)):
        first, active = node["first"].astype(np.int64) & ~(LEAF - 1), _bits(node["active"]).reshape((LEAF,) * 3)
        lattice.leaves.append((first, active, node["values"].reshape((LEAF,) * 3 + value.shape)))
    return lattice


def _root_tiles(data: memoryview, root: int, value: np.dtype[Any], lattice: SparseLattice) -> None:
    """The active tiles of the root, each 4096³ voxels."""
    statistics = _statistics(value)
    head = _aligned(28 + value.itemsize + statistics)
    (count,) = struct.unpack_from("<I", data, root + 24)
    tile = np.dtype({
        "names": ["key", "child", "active", "value"], "formats": ["<u8", "<i8", "<u4", value],
        "offsets": [0, 8, 16, 20 if value.base.itemsize < 8 else 24],
        "itemsize": _aligned((20 if value.base.itemsize < 8 else 24) + value.itemsize),
    })  # fmt: skip
    for each in _table(data, root + head, count, tile):
        if each["child"] == 0 and each["active"]:
            turns = np.array([2 * KEY_BITS, KEY_BITS, 0], np.uint64)
            first = ((each["key"] >> turns) & np.uint64((1 << KEY_BITS) - 1)).astype(np.int64) << 12
            first = (first + (1 << 31)) % (1 << 32) - (1 << 31)
            lattice.tiles.append((first, NODES[0][0] * NODES[0][1], each["value"]))


def _table(data: memoryview, start: int, count: int, kind: np.dtype[Any]) -> NDArray[Any]:
    if start < GRID or count < 0 or start + count * kind.itemsize > len(data):
        raise ValueError("its nodes lie beyond its end")
    return np.frombuffer(data, kind, count, start)


def _leaf_type(value: np.dtype[Any]) -> np.dtype[Any]:
    """first: of its active voxels."""
    start = _aligned(16 + 64 + _statistics(value))
    return np.dtype({
        "names": ["first", "active", "values"], "formats": [("<i4", 3), ("u1", 64), (value, LEAF**3)],
        "offsets": [0, 16, start], "itemsize": _aligned(start + LEAF**3 * value.itemsize),
    })  # fmt: skip


def _node_type(edge: int, value: np.dtype[Any]) -> np.dtype[Any]:
    """A node with edge³ children or values, which share their places."""
    masks, slot = edge**3 // 8, -(-value.itemsize // 8) * 8
    start = _aligned(32 + 2 * masks + _statistics(value))
    table = np.dtype({"names": ["value"], "formats": [value], "offsets": [0], "itemsize": slot})
    return np.dtype({
        "names": ["first", "active", "child", "table"],
        "formats": [("<i4", 3), ("u1", masks), ("u1", masks), (table, edge**3)],
        "offsets": [0, 32, 32 + masks, start], "itemsize": _aligned(start + edge**3 * slot),
    })  # fmt: skip


def _statistics(value: np.dtype[Any]) -> int:
    """Bytes of least, largest, mean and deviation; the last two are one float, or double, each."""
    return 2 * value.itemsize + 2 * (8 if value.base.itemsize == 8 else 4)


def _aligned(size: int) -> int:
    return -(-size // ALIGNED) * ALIGNED


def _bits(data: NDArray[np.uint8]) -> NDArray[np.bool_]:
    return np.unpackbits(data, bitorder="little").astype(bool)
