"""OpenVDB (.vdb): grids of numbers in trees whose nodes have 32³, 16³ and 8³ children or voxels. Lengths are metres.

It is read here, as no wheel of OpenVDB exists, and one of a small reader drops tiles. The order of bytes is that of
OpenVDB's `io/Archive.cc`, `io/Compression.h`, `tree/*Node.h` and `math/Maps.h`, file versions 222 (2013) to 225.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.apart import Arrays
from hagoromo.files.checks import existing_file, read_bytes
from hagoromo.files.format import file_and_part
from hagoromo.files.reading import reading
from hagoromo.files.volume_file import Later, VolumeFile
from hagoromo_formats.volumes.apart_volume import as_arrays, whole_apart
from hagoromo_formats.volumes.sparse_lattice import LEAF, SparseLattice, chosen

MAGIC, VERSIONS = 0x56444220, range(222, 226)
ZIP, ACTIVE_MASK, BLOSC = 1, 2, 4  # flags of compression
HALF = "_HalfFloat"
REACH = ("file_bbox_min", "file_bbox_max")  # first and last voxel, in the facts of a grid
TYPES = {
    "float": ("<f4", 1), "double": ("<f8", 1), "half": ("<f2", 1), "int32": ("<i4", 1), "int64": ("<i8", 1),
    "vec3s": ("<f4", 3), "vec3d": ("<f8", 3), "vec3i": ("<i4", 3),
}  # fmt: skip
NODES = ((32, 128), (16, 8))  # children along an edge, edge of a child in voxels: below the root, above the leaves
MOST_GRIDS = 1000
# what a node says of its inactive values (io/Compression.h)
MINUS, ONE, MASK, MASK_ONE, MASK_TWO, ALL = 1, 2, 3, 4, 5, 6
SCALES = ("UniformScaleMap", "ScaleMap")
MOVED = ("UniformScaleTranslateMap", "ScaleTranslateMap")


@dataclass
class Bytes:
    """The bytes of a file, and where the next one is."""

    data: memoryview
    at: int = 0

    def take(self, size: int) -> memoryview:
        """The next `size` bytes; ValueError where the file ends before."""
        if size < 0 or self.at + size > len(self.data):
            raise ValueError("its bytes end too early")
        self.at += size
        return self.data[self.at - size : self.at]

    def numbers(self, layout: str) -> tuple[Any, ...]:
        """Numbers of `struct`."""
        return struct.unpack("<" + layout, self.take(struct.calcsize("<" + layout)))

    def array(self, kind: Any, *shape: int) -> NDArray[Any]:
        """An array; it is not copied."""
        kind = np.dtype(kind)
        return np.frombuffer(self.take(kind.itemsize * int(np.prod(shape))), kind).reshape(shape)

    def text(self) -> str:
        """A string behind its length."""
        return bytes(self.take(self.numbers("I")[0])).decode("utf-8", "replace")

    def mask(self, edge: int) -> NDArray[np.bool_]:
        """A bit for each of edge³ children or voxels."""
        return np.unpackbits(self.array("u1", edge**3 // 8), bitorder="little").astype(bool)


@dataclass(frozen=True)
class Codec:
    """How the numbers of a grid lie: their type, their type in the file, components, flags, value without matter."""

    kind: np.dtype[Any]
    stored: np.dtype[Any]
    components: int
    flags: int
    background: NDArray[Any]

    def values(self, source: Bytes, active: NDArray[np.bool_]) -> NDArray[Any]:
        """The values of a node (n, components): all, or the active ones and what says which the others are."""
        (layout,) = source.numbers("B")
        if layout > ALL:
            raise ValueError("a node of it has an unknown compression")
        other, first = self.background, self.background if layout != MINUS and layout != MASK else -self.background
        if layout in (ONE, MASK_ONE, MASK_TWO):
            first = source.array(self.kind, self.components)
        if layout == MASK_TWO:
            other = source.array(self.kind, self.components)
        second = source.mask(round(len(active) ** (1 / 3))) if layout in (MASK, MASK_ONE, MASK_TWO) else None
        sparse = bool(self.flags & ACTIVE_MASK) and layout != ALL
        held = self._unpacked(source, int(active.sum()) if sparse else len(active))
        if not sparse:
            return held
        values = np.where(False if second is None else second[:, None], other, first)
        values = np.array(np.broadcast_to(values, (len(active), self.components)), self.kind)
        values[active] = held
        return values

    def _unpacked(self, source: Bytes, count: int) -> NDArray[Any]:
        size = count * self.components * self.stored.itemsize
        if count == 0 and self.stored != self.kind:
            data: Any = b""  # halves of nothing have no size before them
        elif self.flags & (ZIP | BLOSC):
            from hagoromo.files.zarr_codecs import unpacked

            (packed,) = source.numbers("q")
            data = source.take(abs(packed))
            if packed > 0:
                name = "blosc" if self.flags & BLOSC else "zlib"
                data = bytes(unpacked(name, bytes(data), size, True, {})) if size else b""
        else:
            data = source.take(size)
        if len(data) != size:
            raise ValueError("a node of it unpacks to another size than it has")
        return np.frombuffer(data, self.stored).reshape(count, self.components).astype(self.kind)


def read_openvdb(path: str | Path) -> VolumeFile:
    """A grid of a .vdb: its only one, the one called density, or the one named behind a colon: smoke.vdb:flame.

    Read in a process apart. `InputError` for a level set, points, a camera's grid, and what is damaged or does not fit
    the memory, or is far larger than its file.
    """
    file, wanted = file_and_part(path)
    return whole_apart(existing_file(file), "OpenVDB", dense_openvdb, wanted)


def look_at_openvdb(path: str | Path) -> VolumeFile:
    """As `read_openvdb`, without the numbers where the file states how far its grid reaches, as OpenVDB writes it."""
    file, wanted = file_and_part(path)
    source = Bytes(memoryview(read_bytes(file)))
    with reading(file, "OpenVDB"):
        head = _head(source, _entered(source, wanted, str(path), file), str(path))
        reach = [head.facts.get(key, b"") for key in REACH]
        if any(len(end) != 12 for end in reach):
            return read_openvdb(path)
        low, high = (np.frombuffer(end, "<i4").astype(np.int64) for end in reach)
        matrix = head.matrix.copy()
        matrix[:3, 3] += matrix[:3, :3] @ low
        shape = (*(high - low + 1)[::-1].tolist(), *([head.components] if head.components > 1 else []))
        return VolumeFile(Later(shape, head.kind, lambda: read_openvdb(path).values), matrix, str(path))


def dense_openvdb(file: Path, wanted: str) -> Arrays:
    """The values and the matrix of a grid; run by `read_apart`."""
    source, where = Bytes(memoryview(read_bytes(file, growth=3.0))), f"{file}:{wanted}" if wanted else str(file)
    with reading(file, "OpenVDB"):
        lattice = _grid(source, _head(source, _entered(source, wanted, where, str(file)), where), where)
    return as_arrays(lattice.dense(where, file))


def _entered(source: Bytes, wanted: str, where: str, file: str) -> str:
    """The type of the grid that is wanted, at which `source` then stands."""
    _check_head(source, file)
    grids = {}
    for _ in range(source.numbers("i")[0]):
        name, kind, parent = source.text().split("\x1e")[0], source.text(), source.text()
        start, _, end = source.numbers("3q")
        grids.setdefault(name, (kind, parent, start))
        source.at = end
        if len(grids) > MOST_GRIDS:
            raise InputError(f"{file} has more than {MOST_GRIDS} grids: write the one you need")
    kind, parent, source.at = chosen(grids, wanted, file)
    if parent:
        raise InputError(f"{where} is an instance of {parent:.60}: name that grid")
    return kind


def _check_head(source: Bytes, where: str) -> None:
    """Read what stands before the grids; `InputError` for another version than those that are read."""
    magic, version = source.numbers("qI")
    if magic != MAGIC:
        raise InputError(f"{where} is no OpenVDB: give a .vdb")
    if version not in VERSIONS:
        raise InputError(f"{where} is of version {version}: {VERSIONS[0]} to {VERSIONS[-1]} are read, write it anew")
    _, _, offsets = source.numbers("IIB")
    if not offsets:
        raise InputError(f"{where} was written to a stream, without the places of its grids: write it to a file")
    source.take(36)  # its unique number
    _metadata(source)


def _metadata(source: Bytes) -> dict[str, bytes]:
    """Keys and the bytes of their values."""
    found = {}
    for _ in range(source.numbers("I")[0]):
        key, _, size = source.text(), source.text(), source.numbers("I")[0]
        found[key] = bytes(source.take(size))
    return found


class Head(NamedTuple):
    """What stands before a tree: type of its numbers and of those in the file, components, flags, facts, place."""

    kind: np.dtype[Any]
    stored: np.dtype[Any]
    components: int
    flags: int
    facts: dict[str, bytes]
    matrix: NDArray[np.float64]


def _head(source: Bytes, kind: str, where: str) -> Head:
    name = kind.removesuffix(HALF).removeprefix("Tree_").removesuffix("_5_4_3")
    if name not in TYPES or not kind.removesuffix(HALF).endswith("_5_4_3"):
        raise InputError(f"{where} is a grid of type {kind:.40}: {', '.join(TYPES)} are read, in trees of 5, 4, 3")
    (flags,) = source.numbers("I")
    facts = _metadata(source)
    stored, components = np.dtype(TYPES[name][0]), TYPES[name][1]
    half = np.dtype("<f2") if kind.endswith(HALF) and stored.kind == "f" else stored
    return Head(stored, half, components, flags, facts, _map(source, where))


def _grid(source: Bytes, head: Head, where: str) -> SparseLattice:
    stored, components, use = head.kind, head.components, head.facts.get("class", b"").decode("utf-8", "replace")
    if source.numbers("I")[0] != 1:
        raise ValueError("its leaves have several buffers")
    background = source.array(stored, components)
    codec = Codec(stored, head.stored, components, head.flags, background)
    single = components == 1
    lattice = SparseLattice(where, use, stored, components, background[0] if single else background, head.matrix)
    tiles, children = source.numbers("II")
    for _ in range(tiles):
        first, value = source.array("<i4", 3).astype(np.int64), source.array(stored, components)
        if source.numbers("B")[0]:
            lattice.tiles.append((first, NODES[0][0] * NODES[0][1], value[0] if single else value))
    leaves: list[NDArray[np.int64]] = []
    for _ in range(children):
        _topology(source, codec, lattice, source.array("<i4", 3).astype(np.int64), 0, leaves)
    for first in leaves:
        active = source.mask(LEAF)
        values = codec.values(source, active)
        shape = (LEAF,) * 3 if single else (LEAF, LEAF, LEAF, components)
        lattice.leaves.append((first, active.reshape((LEAF,) * 3), values.reshape(shape)))
    return lattice


def _topology(
    source: Bytes, codec: Codec, lattice: SparseLattice, first: NDArray[np.int64], level: int, leaves: list[Any]
) -> None:
    """The tiles of a node, and the first voxels of the leaves below it, in the order of their values further on."""
    if level == len(NODES):
        source.mask(LEAF)
        leaves.append(first)
        return
    edge, width = NODES[level]
    child, active = source.mask(edge), source.mask(edge)
    values = codec.values(source, active)
    places = np.stack(np.unravel_index(np.arange(edge**3), (edge,) * 3), axis=1) * width + first
    for k in np.flatnonzero(active & ~child):
        lattice.tiles.append((places[k], width, values[k, 0] if codec.components == 1 else values[k]))
    for k in np.flatnonzero(child):
        _topology(source, codec, lattice, places[k], level + 1, leaves)


def _map(source: Bytes, where: str) -> NDArray[np.float64]:
    """Index (x, y, z) → place, of the kinds of map that are linear."""
    kind, matrix = source.text(), np.eye(4)
    if kind in ("AffineMap", "UnitaryMap"):
        return source.array("<f8", 4, 4).T.copy()  # of OpenVDB's rows
    if kind == "TranslationMap" or kind in MOVED:
        matrix[:3, 3] = source.array("<f8", 3)
    if kind in SCALES or kind in MOVED:
        matrix[:3, :3] = np.diag(source.array("<f8", 5, 3)[0])
    elif kind != "TranslationMap":
        raise InputError(f"{where} lies by a {kind:.40}: linear maps are read")
    return matrix
