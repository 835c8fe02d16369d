"""OpenEXR's layout (openexr.com, "OpenEXR File Layout"): all headers, and pixels in lines, packed by ZIP or not.

OpenEXR's library prints what it finds wrong with a file; these functions only raise. They raise whatever comes to them
at damaged bytes: call them within `reading`.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from os import cpu_count
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

MAGIC = b"\x76\x2f\x31\x01"
TILED, DEEP, PARTS = 0x200, 0x800, 0x1000  # flags of the version
KINDS = {0: "<u4", 1: "<f2", 2: "<f4"}  # types of pixels
LINES = {0: 1, 2: 1, 3: 16}  # compression (none, ZIPS, ZIP) → lines of a chunk
MOST_LINES = 256  # of a chunk, of any compression
CHUNK = struct.Struct("<ii")  # first line, bytes
THREADS = min(cpu_count() or 1, 4)


class Part(NamedTuple):
    """texts: of the attributes that are texts. channels: name → (type of pixels, step along x, step along y).

    window: first and last column and row (left, top, right, bottom). compression: by its number. rows_together: of a
    tile, or most that are packed together.
    """

    texts: dict[str, str]
    channels: dict[str, tuple[int, int, int]]
    window: tuple[int, int, int, int]
    compression: int
    rows_together: int

    @property
    def width(self) -> int:
        """Columns."""
        return self.window[2] - self.window[0] + 1

    @property
    def height(self) -> int:
        """Rows."""
        return self.window[3] - self.window[1] + 1


class Layout(NamedTuple):
    """parts: at least one. in_lines: whether `read_lines` reads it. end: offset behind the headers."""

    parts: list[Part]
    in_lines: bool
    end: int


def read_layout(data: bytes) -> Layout:
    """The headers of a file."""
    (flags,) = struct.unpack_from("<I", data, 4)
    parts, offset = [], 8
    while True:
        attributes: dict[str, tuple[str, bytes]] = {}
        while data[offset]:
            name, offset = _name(data, offset)
            kind, offset = _name(data, offset)
            (size,) = struct.unpack_from("<i", data, offset)
            value = data[offset + 4 : offset + 4 + size]
            if size < 0 or len(value) < size:
                raise ValueError("its header ends early")
            attributes[name], offset = (kind, value), offset + 4 + size
        offset += 1
        parts.append(_part(attributes))
        if not flags & PARTS or data[offset] == 0:
            break
    one = parts[0]
    plain = not flags & (TILED | DEEP | PARTS) and one.compression in LINES
    return Layout(
        parts, plain and all(kind in KINDS and (x, y) == (1, 1) for kind, x, y in one.channels.values()), offset
    )


def read_lines(data: bytes, layout: Layout) -> dict[str, NDArray[np.float32]]:
    """The channels, name → (height, width); ValueError unless all lines are there."""
    part = layout.parts[0]
    lines = LINES[part.compression]
    count = -(-part.height // lines)
    places = struct.unpack_from(f"<{count}Q", data, layout.end)
    if min(places) < layout.end + 8 * count or max(places) + CHUNK.size > len(data):
        raise ValueError("lines are missing")
    kind = np.dtype([(name, KINDS[channel[0]], (part.width,)) for name, channel in part.channels.items()])
    pixels = {name: np.empty((part.height, part.width), np.float32) for name in part.channels}

    def unpack(place: int) -> int:
        first, size = CHUNK.unpack_from(data, place)
        row = first - part.window[1]
        packed = memoryview(data)[place + CHUNK.size :][: max(size, 0)]
        if row < 0 or row >= part.height or row % lines or len(packed) != size:
            raise ValueError("a chunk of lines is not where it should be")
        rows = min(lines, part.height - row)
        values = np.frombuffer(_unpacked(packed, rows * kind.itemsize, part.compression), kind)
        for name, channel in pixels.items():
            channel[row : row + rows] = values[name]
        return row

    with ThreadPoolExecutor(THREADS) as threads:
        if len(set(threads.map(unpack, places))) != count:
            raise ValueError("lines are missing")
    return pixels


def _part(attributes: Mapping[str, tuple[str, bytes]]) -> Part:
    texts = {
        name: value.decode("utf-8", "replace")
        for name, (kind, value) in attributes.items()
        if kind == "string" and name != "type"
    }
    left, top, right, bottom = struct.unpack("<4i", attributes["dataWindow"][1])
    if right < left or bottom < top:
        raise ValueError(f"its window has {right - left + 1} × {bottom - top + 1} pixels")
    channels, data, offset = {}, attributes["channels"][1], 0
    while data[offset]:
        name, offset = _name(data, offset)
        channels[name] = struct.unpack_from("<i4xii", data, offset)
        offset += 16
    if not channels:
        raise ValueError("it has no channel")
    rows = struct.unpack_from("<II", attributes["tiles"][1])[1] if "tiles" in attributes else MOST_LINES
    return Part(texts, channels, (left, top, right, bottom), attributes["compression"][1][0], rows)


def _name(data: bytes, offset: int) -> tuple[str, int]:
    """A text that ends with a zero, and the offset behind it."""
    end = data.index(b"\0", offset, offset + 256)
    return data[offset:end].decode("utf-8", "replace"), end + 1


def _unpacked(packed: memoryview, size: int, compression: int) -> NDArray[np.uint8] | memoryview:
    """`size` bytes of lines: stored as they are where packing does not help."""
    if compression == 0 or len(packed) == size:
        if len(packed) != size:
            raise ValueError("a chunk of lines has another size than its header says")
        return packed
    unpacker = zlib.decompressobj()
    raw = np.frombuffer(unpacker.decompress(packed, size + 1), np.uint8)
    if len(raw) != size:
        raise ValueError("a chunk of lines unpacks to another size than its header says")
    sums = np.add.accumulate(raw, dtype=np.uint8)  # each byte was stored as its difference from the last one, + 128
    sums[1::2] ^= 128
    half = (size + 1) // 2
    both = np.empty(size, np.uint8)
    both[0::2], both[1::2] = sums[:half], sums[half:]
    return both
