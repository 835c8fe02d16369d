"""Serialized: meshes of Mitsuba's .serialized files: compressed (zlib), several in one, found by a list at its end."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.checks import read_bytes, sized_file
from hagoromo.files.memory import require
from hagoromo.files.reading import reading

MAGIC, VERSIONS = 0x041C, (3, 4)
HAS_NORMALS, HAS_UV, HAS_COLOURS, IS_DOUBLE = 0x0001, 0x0002, 0x0008, 0x2000
LARGEST = 1 << 32  # bytes of a file
MOST_SHAPES = 1 << 16
LONGEST_NAME = 1 << 12


def read_serialized(path: str | Path, number: int = 0) -> tuple[NDArray[np.float64], NDArray[np.uint32]]:
    """Vertices (n, 3) and faces (m, 3) of a mesh of the file; `InputError` for a damaged file, and one without it."""
    data = read_bytes(sized_file(path, LARGEST, "a mesh file"), 2.0)
    with reading(path, "Mitsuba's serialized meshes"):
        magic, version = struct.unpack_from("<HH", data)
        if magic != MAGIC or version not in VERSIONS:
            raise ValueError(f"its head is {magic:#x}, version {version}")
        begin, end = _places(data, version, number, str(path))
        return _mesh(data[begin + 4 : end], version, str(path))


def _places(data: bytes, version: int, number: int, where: str) -> tuple[int, int]:
    """Where a mesh begins and ends."""
    (count,) = struct.unpack_from("<I", data, len(data) - 4)
    if not 0 <= number < count <= MOST_SHAPES:
        raise InputError(f"{where} holds {count} meshes: there is no number {number}")
    size = 8 if version == 4 else 4
    start = len(data) - 4 - size * count
    offsets = struct.unpack_from(f"<{count}{'Q' if size == 8 else 'I'}", data, start)
    ends = (*offsets[1:], start)
    return offsets[number], ends[number]


def _mesh(packed: bytes, version: int, where: str) -> tuple[NDArray[np.float64], NDArray[np.uint32]]:
    unpack = zlib.decompressobj()
    head = unpack.decompress(packed, 4 + (LONGEST_NAME if version == 4 else 0) + 16)
    (flags,) = struct.unpack_from("<I", head)
    at = 4
    if version == 4:
        at = head.index(b"\0", at) + 1
    vertices, faces = struct.unpack_from("<QQ", head, at)
    real = "<f8" if flags & IS_DOUBLE else "<f4"
    item = np.dtype(real).itemsize
    numbers = 3 + 3 * bool(flags & HAS_NORMALS) + 2 * bool(flags & HAS_UV) + 3 * bool(flags & HAS_COLOURS)
    size = at + 16 + vertices * numbers * item + 12 * faces
    require(4.0 * float(size), f"a mesh of {vertices} vertices in {where}")
    body = head + unpack.decompress(unpack.unconsumed_tail, max(size - len(head), 1))
    places = np.frombuffer(body, real, 3 * vertices, at + 16).reshape(-1, 3).astype(float)
    corners = np.frombuffer(body, "<u4", 3 * faces, at + 16 + vertices * numbers * item).reshape(-1, 3)
    return places, corners.copy()
