"""OpenVDB out: fields of one lattice as grids of a .vdb, packed by zlib, with leaves only where there is matter.

The order of bytes is that of file version 224 (OpenVDB's `io/Archive.cc`, `io/File.cc`, `tree/*Node.h`).
"""

from __future__ import annotations

import hashlib
import itertools
import struct
import uuid
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.files.whole import whole_file
from hagoromo_formats.volumes.lattice_field import LatticeField, lattice_field, slabs
from hagoromo_formats.volumes.openvdb import ACTIVE_MASK, MAGIC, NODES, ZIP
from hagoromo_formats.volumes.sparse_lattice import LEAF

VERSION, LIBRARY = 224, (10, 0)
ALL_BACKGROUND = b"\0"  # what a node says of its inactive values
NAMES = {1: "float", 3: "vec3s"}  # types of grids by their components
ROOT_EDGE = NODES[0][0] * NODES[0][1]  # voxels along a child of the root
CUBE = NODES[0][1]  # and along a child of that
PLACES = struct.Struct("<3q")  # where a grid, its numbers and the next grid begin


class Leaf(NamedTuple):
    """A cube of LEAF³ voxels that has active ones: its first voxel (x, y, z), and which are active, a bit each.

    low, high: first and last active voxel along each axis. count: active voxels.
    """

    corner: tuple[int, ...]
    mask: bytes
    low: tuple[int, ...]
    high: tuple[int, ...]
    count: int


def write_openvdb(
    path: str | Path, fields: Mapping[str, NDArray[np.float32] | LatticeField], matrix: NDArray[np.float64]
) -> None:
    """Write fields (nz, ny, nx[, 3]) [world: m], by their names; voxels are active where the first one is not 0.

    matrix: of a `VolumeFile`. Without matter the grids are empty. Memory holds a cube of CUBE³ voxels, and the masks of
    all leaves. (OpenVDB file format, version 224.)
    """
    lattices = {name: lattice_field(values) for name, values in fields.items()}
    leaves = _leaves(next(iter(lattices.values())))
    digest = hashlib.sha1()
    for field in lattices.values():
        for slab in slabs(field):
            digest.update(slab.data)
    number = str(uuid.UUID(bytes=digest.digest()[:16], version=5)).encode()
    head = struct.pack("<qIIIB", MAGIC, VERSION, *LIBRARY, 1) + number + _metadata({}) + struct.pack("<i", len(fields))
    with whole_file(path, force=True) as partial, partial.open("wb") as file:
        file.write(head)
        for name, field in lattices.items():
            components = field.shape[3] if len(field.shape) == 4 else 1
            file.write(_text(name) + _text(f"Tree_{NAMES[components]}_5_4_3") + _text(""))
            places = file.tell()
            file.write(bytes(PLACES.size))
            begin = file.tell()
            tree = _topology(leaves, components)
            file.write(_grid_head(name, leaves, matrix) + struct.pack("<I", 1) + bytes(4 * components) + tree)
            middle = file.tell()
            for numbers in _numbers(field, leaves):
                file.write(numbers)
            end = file.tell()
            file.seek(places)
            file.write(PLACES.pack(begin, middle, end))
            file.seek(end)


def _leaves(density: LatticeField) -> list[Leaf]:
    """The leaves of a field, in the order of the tree."""
    found = []
    for first, part in _cubes(density):
        for corner in itertools.product(*(range(0, n, LEAF) for n in part.shape)):
            block = part[tuple(slice(c, c + LEAF) for c in corner)] != 0
            if block.any():
                active = np.zeros((LEAF,) * 3, bool)
                active[tuple(map(slice, block.shape))] = block
                place, where = np.add(first, corner), np.argwhere(active)
                low, high = (tuple((place + end).tolist()) for end in (where.min(0), where.max(0)))
                found.append(Leaf(tuple(place.tolist()), _mask(active), low, high, len(where)))
    return found


def _numbers(field: LatticeField, leaves: list[Leaf]) -> Iterator[bytes]:
    """Which voxels of every leaf are active, and their numbers."""
    for cube, group in itertools.groupby(leaves, lambda leaf: _cube(leaf, CUBE)):
        first = np.multiply(cube, CUBE)
        part = _part(field, first)
        for leaf in group:
            start = np.subtract(leaf.corner, first)
            block = part[tuple(slice(c, c + LEAF) for c in start)]
            yield (
                leaf.mask + ALL_BACKGROUND + _packed(block[_active(leaf)[tuple(map(slice, block.shape[:3]))]].tobytes())
            )


def _cubes(field: LatticeField) -> Iterator[tuple[NDArray[np.int64], NDArray[np.float32]]]:
    """First voxel (x, y, z) and numbers of every cube of CUBE³ voxels of a lattice, in the order of the tree."""
    whole = field.shape[2::-1]
    for root in itertools.product(*(range(0, n, ROOT_EDGE) for n in whole)):
        ends = (range(r, min(r + ROOT_EDGE, n), CUBE) for r, n in zip(root, whole, strict=True))
        for first in itertools.product(*ends):
            yield np.array(first), _part(field, np.array(first))


def _part(field: LatticeField, first: NDArray[np.int64]) -> NDArray[np.float32]:
    """The numbers of the cube from voxel `first` (x, y, z) on, with x first."""
    last = np.minimum(first + CUBE, field.shape[2::-1])
    part = field.part(first[::-1].tolist(), last[::-1].tolist())
    return np.ascontiguousarray(np.swapaxes(part, 0, 2), "<f4")


def _topology(leaves: list[Leaf], components: int) -> bytes:
    """The nodes of the tree, depth first, with the active voxels of the leaves; there are no tiles."""
    roots = [(key, list(group)) for key, group in itertools.groupby(leaves, lambda leaf: _cube(leaf, ROOT_EDGE))]
    parts = [struct.pack("<II", 0, len(roots))]
    for key, below in roots:
        parts.append(struct.pack("<3i", *(k * ROOT_EDGE for k in key)))
        parts.append(_node(below, 0))
        for _, lower in itertools.groupby(below, lambda leaf: _cube(leaf, CUBE)):
            held = list(lower)
            parts.append(_node(held, 1))
            parts += [leaf.mask for leaf in held]
    return b"".join(parts)


def _cube(leaf: Leaf, edge: int) -> tuple[int, ...]:
    return tuple(c // edge for c in leaf.corner)


def _node(leaves: list[Leaf], level: int) -> bytes:
    """A node above `leaves`: which children it has, no active tile, and no value but the background."""
    edge, width = NODES[level]
    children = np.zeros((edge,) * 3, bool)
    for leaf in leaves:
        children[tuple(c // width % edge for c in leaf.corner)] = True
    return _mask(children) + bytes(edge**3 // 8) + ALL_BACKGROUND + _packed(b"")


def _active(leaf: Leaf) -> NDArray[np.bool_]:
    bits = np.unpackbits(np.frombuffer(leaf.mask, np.uint8), bitorder="little")
    return bits.reshape((LEAF,) * 3).astype(bool)


def _mask(bits: NDArray[np.bool_]) -> bytes:
    return np.packbits(bits.ravel(), bitorder="little").tobytes()


def _packed(data: bytes) -> bytes:
    """Packed behind its size, or as it is behind its negative size where packing does not help."""
    packed = zlib.compress(data)
    return struct.pack("<q", len(packed)) + packed if len(packed) < len(data) else struct.pack("<q", -len(data)) + data


def _grid_head(name: str, leaves: list[Leaf], matrix: NDArray[np.float64]) -> bytes:
    """Flags, facts and place of a grid."""
    low = np.min([leaf.low for leaf in leaves], axis=0) if leaves else np.zeros(3, int)
    high = np.max([leaf.high for leaf in leaves], axis=0) if leaves else np.zeros(3, int)
    facts = {
        "name": ("string", name.encode()),
        "class": ("string", b"fog volume"),
        "is_saved_as_half_float": ("bool", b"\0"),
        "file_bbox_min": ("vec3i", struct.pack("<3i", *low)),
        "file_bbox_max": ("vec3i", struct.pack("<3i", *high)),
        "file_voxel_count": ("int64", struct.pack("<q", sum(leaf.count for leaf in leaves))),
    }
    rows = np.ascontiguousarray(matrix.T, "<f8").tobytes()
    return struct.pack("<I", ZIP | ACTIVE_MASK) + _metadata(facts) + _text("AffineMap") + rows


def _metadata(facts: Mapping[str, tuple[str, bytes]]) -> bytes:
    rows = (_text(key) + _text(kind) + struct.pack("<I", len(data)) + data for key, (kind, data) in facts.items())
    return struct.pack("<I", len(facts)) + b"".join(rows)


def _text(text: str) -> bytes:
    data = text.encode()
    return struct.pack("<I", len(data)) + data
