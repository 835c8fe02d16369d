"""OpenVDB out: fields of one lattice as grids of a .vdb, packed by zlib, with leaves only where there is matter.

The order of bytes is that of file version 224 (OpenVDB's `io/Archive.cc`, `io/File.cc`, `tree/*Node.h`).
"""

from __future__ import annotations

import hashlib
import itertools
import struct
import uuid
import zlib
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hagoromo.files.whole import whole_file
from hagoromo_formats.volumes.openvdb import ACTIVE_MASK, MAGIC, NODES, ZIP
from hagoromo_formats.volumes.sparse_lattice import LEAF

VERSION, LIBRARY = 224, (10, 0)
ALL_BACKGROUND = b"\0"  # what a node says of its inactive values
NAMES = {1: "float", 3: "vec3s"}  # types of grids by their components
ROOT_EDGE = NODES[0][0] * NODES[0][1]  # voxels along a child of the root

Leaf = tuple[tuple[int, int, int], NDArray[np.bool_]]


def write_openvdb(path: str | Path, fields: Mapping[str, NDArray[np.float32]], matrix: NDArray[np.float64]) -> None:
    """Write fields (nz, ny, nx[, 3]) [world: m], by their names; voxels are active where the first one is not 0.

    matrix: of a `VolumeFile`. Without matter the grids are empty. (OpenVDB file format, version 224.)
    """
    density = np.swapaxes(next(iter(fields.values())), 0, 2)
    leaves = _leaves(density)
    digest = hashlib.sha1(b"".join(np.ascontiguousarray(each).tobytes() for each in fields.values()))
    number = str(uuid.UUID(bytes=digest.digest()[:16], version=5)).encode()
    head = struct.pack("<qIIIB", MAGIC, VERSION, *LIBRARY, 1) + number + _metadata({}) + struct.pack("<i", len(fields))
    with whole_file(path, force=True) as partial, partial.open("wb") as file:
        file.write(head)
        at = len(head)
        for name, values in fields.items():
            lattice = np.ascontiguousarray(np.swapaxes(values, 0, 2), "<f4")
            components = lattice.shape[3] if lattice.ndim == 4 else 1
            start = _text(name) + _text(f"Tree_{NAMES[components]}_5_4_3") + _text("")
            tree = _topology(leaves, components)
            grid = _grid_head(name, leaves, matrix) + struct.pack("<I", 1) + bytes(4 * components) + tree
            numbers = b"".join(_leaf(lattice, *leaf) for leaf in leaves)
            begin = at + len(start) + 24
            places = (begin, begin + len(grid), begin + len(grid) + len(numbers))
            for part in (start, struct.pack("<3q", *places), grid, numbers):
                file.write(part)
            at = places[2]


def _leaves(density: NDArray[np.float32]) -> list[Leaf]:
    """First voxel and active voxels (8, 8, 8) of each cube that has any, in the order of the tree."""
    found: list[Leaf] = []
    for corner in itertools.product(*(range(0, n, LEAF) for n in density.shape)):
        block = density[tuple(slice(c, c + LEAF) for c in corner)] != 0
        if block.any():
            active = np.zeros((LEAF,) * 3, bool)
            active[tuple(map(slice, block.shape))] = block
            z, y, x = corner
            found.append(((z, y, x), active))

    def order(leaf: Leaf) -> list[int]:
        return [c // edge for edge in (ROOT_EDGE, NODES[0][1], LEAF) for c in leaf[0]]

    return sorted(found, key=order)


def _topology(leaves: list[Leaf], components: int) -> bytes:
    """The nodes of the tree, depth first, with the active voxels of the leaves; there are no tiles."""
    roots = [(key, list(group)) for key, group in itertools.groupby(leaves, lambda leaf: _cube(leaf, ROOT_EDGE))]
    parts = [struct.pack("<II", 0, len(roots))]
    for key, below in roots:
        parts.append(struct.pack("<3i", *(k * ROOT_EDGE for k in key)))
        parts.append(_node(below, 0))
        for _, lower in itertools.groupby(below, lambda leaf: _cube(leaf, NODES[0][1])):
            held = list(lower)
            parts.append(_node(held, 1))
            parts += [_mask(active) for _, active in held]
    return b"".join(parts)


def _cube(leaf: Leaf, edge: int) -> tuple[int, ...]:
    return tuple(c // edge for c in leaf[0])


def _node(leaves: list[Leaf], level: int) -> bytes:
    """A node above `leaves`: which children it has, no active tile, and no value but the background."""
    edge, width = NODES[level]
    children = np.zeros((edge,) * 3, bool)
    for corner, _ in leaves:
        children[tuple(c // width % edge for c in corner)] = True
    return _mask(children) + bytes(edge**3 // 8) + ALL_BACKGROUND + _packed(b"")


def _leaf(lattice: NDArray[np.float32], corner: tuple[int, int, int], active: NDArray[np.bool_]) -> bytes:
    """Which voxels of a leaf are active, and their numbers."""
    block = lattice[tuple(slice(c, c + LEAF) for c in corner)]
    values = block[active[tuple(map(slice, block.shape[:3]))]]
    return _mask(active) + ALL_BACKGROUND + _packed(values.tobytes())


def _mask(bits: NDArray[np.bool_]) -> bytes:
    return np.packbits(bits.ravel(), bitorder="little").tobytes()


def _packed(data: bytes) -> bytes:
    """Packed behind its size, or as it is behind its negative size where packing does not help."""
    packed = zlib.compress(data)
    return struct.pack("<q", len(packed)) + packed if len(packed) < len(data) else struct.pack("<q", -len(data)) + data


def _grid_head(name: str, leaves: list[Leaf], matrix: NDArray[np.float64]) -> bytes:
    """Flags, facts and place of a grid."""
    ends = [(np.add(c, where.min(0)), np.add(c, where.max(0)))
            for c, where in ((corner, np.argwhere(active)) for corner, active in leaves)]  # fmt: skip
    low = np.min([e[0] for e in ends], axis=0) if ends else np.zeros(3, int)
    high = np.max([e[1] for e in ends], axis=0) if ends else np.zeros(3, int)
    facts = {
        "name": ("string", name.encode()),
        "class": ("string", b"fog volume"),
        "is_saved_as_half_float": ("bool", b"\0"),
        "file_bbox_min": ("vec3i", struct.pack("<3i", *low)),
        "file_bbox_max": ("vec3i", struct.pack("<3i", *high)),
        "file_voxel_count": ("int64", struct.pack("<q", sum(int(active.sum()) for _, active in leaves))),
    }
    rows = np.ascontiguousarray(matrix.T, "<f8").tobytes()
    return struct.pack("<I", ZIP | ACTIVE_MASK) + _metadata(facts) + _text("AffineMap") + rows


def _metadata(facts: Mapping[str, tuple[str, bytes]]) -> bytes:
    rows = (_text(key) + _text(kind) + struct.pack("<I", len(data)) + data for key, (kind, data) in facts.items())
    return struct.pack("<I", len(facts)) + b"".join(rows)


def _text(text: str) -> bytes:
    data = text.encode()
    return struct.pack("<I", len(data)) + data
