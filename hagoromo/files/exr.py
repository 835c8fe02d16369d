"""OpenEXR: named float32 channels with text metadata.

OpenEXR's layout (openexr.com, "OpenEXR File Layout"): all headers, and pixels in lines, packed by ZIP or not.

OpenEXR's library prints what it finds wrong with a file; these functions only raise. They raise whatever comes to them
at damaged bytes: call them within `reading`.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from os import cpu_count
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.apart import read_apart
from hagoromo.files.checks import PACKED, check_density, existing_file, read_bytes
from hagoromo.files.finite import check_finite
from hagoromo.files.memory import require
from hagoromo.files.reading import reading
from hagoromo.files.whole import check_written, whole_file

HEADER_BYTES = 1 << 18  # first bytes of a file that are read for its header alone
LINES_TOGETHER = 16  # that ZIP packs
LEAST_BYTES = 2.0  # of a sample in the file, a half float
BYTES_PER_SAMPLE = 8.0  # as the file has it, up to 4, and as float32
PREFIX = "channel "  # of names of channels among those of arrays
MAGIC = b"\x76\x2f\x31\x01"
TILED, DEEP, PARTS = 0x200, 0x800, 0x1000  # flags of the version
KINDS = {0: "<u4", 1: "<f2", 2: "<f4"}  # types of pixels
LINES = {0: 1, 2: 1, 3: 16}  # compression (none, ZIPS, ZIP) → lines of a chunk
MOST_LINES = 256  # of a chunk, of any compression
CHUNK = struct.Struct("<ii")  # first line, bytes
THREADS = min(cpu_count() or 1, 4)


def write_exr(
    path: str | Path,
    channels: Mapping[str, NDArray],
    metadata: Mapping[str, str] | None = None,
    half: bool = False,
    tile: int = 0,
    parts: bool = False,
) -> None:
    """Write `channels`, name → (height, width), as float32 (or half floats) with lossless compression.

    tile: edge of the tiles [px] (0: in lines). parts: a part for each layer, the channels whose names begin alike up to
    their last dot; those without a dot are the first. The text `metadata` is in the first part.
    `InputError` when there is no channel, their shapes differ, or a value is not finite in that precision.
    """
    import OpenEXR

    precision = np.float16 if half else np.float32
    with np.errstate(over="ignore"):
        arrays = {name: np.ascontiguousarray(values, dtype=precision) for name, values in channels.items()}
    shapes = sorted({values.shape for values in arrays.values()})
    if len(shapes) != 1 or len(shapes[0]) != 2 or 0 in shapes[0]:
        raise InputError(f"the channels of an EXR have shapes {shapes}: give one shape (height, width) for all")
    check_finite({f"channel {name}": values for name, values in arrays.items()}, Path(path).name)
    height, width = shapes[0]
    layout: dict[str, Any] = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    chunks = -(-height // LINES_TOGETHER)
    if tile:
        layout |= {"type": OpenEXR.tiledimage, "tiles": _tiles(tile)}
        chunks = -(-height // tile) * -(-width // tile)
    layers = _layers(arrays) if parts else {"": arrays}
    with whole_file(path, force=True) as partial:
        try:
            made = [
                OpenEXR.Part({**(metadata or {} if k == 0 else {}), **layout}, held, name or "rgba")
                for k, (name, held) in enumerate(layers.items())
            ]
            with OpenEXR.File(made) if len(made) > 1 else OpenEXR.File({**(metadata or {}), **layout}, arrays) as file:
                file.write(str(partial))
        except RuntimeError:  # of a write that failed
            check_written(partial, path, whole=False)
        check_written(partial, path, _is_whole(partial, len(layers), chunks, bool(tile)))


def _tiles(edge: int) -> Any:
    import OpenEXR

    tiles = OpenEXR.TileDescription()
    tiles.xSize = tiles.ySize = edge
    return tiles


def _layers(arrays: Mapping[str, NDArray]) -> dict[str, dict[str, NDArray]]:
    """Channels by their layers, that without a name first."""
    layers: dict[str, dict[str, NDArray]] = {}
    for name, values in sorted(arrays.items(), key=lambda each: "." in each[0]):
        layers.setdefault(name.rpartition(".")[0], {})[name] = values
    return layers


def _is_whole(path: Path, parts: int, chunks: int, tiled: bool) -> bool:
    """Whether an EXR that `write_exr` wrote has all its chunks: the library says nothing where the disk was full."""
    size = path.stat().st_size if path.exists() else 0
    with path.open("rb") as file:
        file.seek(len(MAGIC) + 4)
        for _ in range(parts):
            while _text(file):  # name, type, size and value of an attribute; an empty name ends them
                _text(file)
                file.seek(struct.unpack("<i", file.read(4).ljust(4, b"\0"))[0], os.SEEK_CUR)
        if parts > 1:
            file.read(1)  # an empty header ends them
        table = file.read(8 * chunks * parts).ljust(8 * chunks * parts, b"\0")
        places = struct.unpack(f"<{chunks * parts}Q", table)
        before = (4 if parts > 1 else 0) + (16 if tiled else 4)  # number of the part; of the line, or of the tile
        file.seek(max(places) + before)
        last = struct.unpack("<i", file.read(4).ljust(4, b"\0"))[0]
    return min(places) > 0 and last > 0 and max(places) + before + 4 + last == size


def _text(file: BinaryIO) -> bytes:
    """The bytes before the next zero."""
    return b"".join(iter(lambda: file.read(1).strip(b"\0"), b""))


def read_header(path: str | Path) -> dict[str, str]:
    """The text metadata of the first part; `InputError` if the file is missing or not an EXR."""
    return exr_header(path).texts


def exr_header(path: str | Path) -> Part:
    """The header of the first part; `InputError` if the file is missing, not an EXR, or too small for its pixels."""
    with existing_file(path).open("rb") as file:
        start = file.read(HEADER_BYTES)
    if len(start) == HEADER_BYTES and start.startswith(MAGIC):
        with suppress(Exception):  # a header that is longer, or damaged: the whole file is read
            return _checked(read_layout(start), path).parts[0]
    return _layout(path)[1].parts[0]


def read_exr(path: str | Path) -> tuple[dict[str, NDArray[np.float32]], dict[str, str]]:
    """Channels, name → (height, width) float32, and the text metadata of the first part.

    Lines that are packed by ZIP or not at all are read here; what else there is (tiles, parts, PIZ, …) by OpenEXR's
    library in a process of its own, because it prints. `InputError` if the file is missing, not an EXR, truncated, or
    larger than the free memory.
    """
    data, layout = _layout(path)
    require(sum(map(_pixel_bytes, layout.parts)), str(path))
    if layout.in_lines:
        with reading(path, "EXR"):
            return read_lines(data, layout), layout.parts[0].texts
    channels = read_apart(channels_by_library, Path(path), "EXR")
    return {name.removeprefix(PREFIX): values for name, values in channels.items()}, layout.parts[0].texts


def _pixel_bytes(part: Part) -> float:
    """Memory [byte] of the pixels of a part, as they are read and as float32: the library reads all parts."""
    return BYTES_PER_SAMPLE * part.width * (part.height - 1.0 + part.rows_together) * len(part.channels)


def channels_by_library(path: Path) -> dict[str, NDArray[np.float32]]:
    """PREFIX + name → (height, width), of the first part, by OpenEXR's library; run by `read_apart`."""
    import OpenEXR

    with reading(path, "EXR"):
        file = OpenEXR.File(str(path), separate_channels=True)
        if not file.parts:
            raise InputError(f"{path} cannot be read as EXR: it is cut off or damaged: copy it again")
        channels = file.channels().items()
        return {PREFIX + name: np.asarray(channel.pixels, dtype=np.float32) for name, channel in channels}


def _layout(path: str | Path) -> tuple[bytes, Layout]:
    """The bytes of an EXR, and its headers."""
    data = read_bytes(path)
    if not data.startswith(MAGIC):
        raise InputError(f"{path} is not an EXR file: give an EXR")
    with reading(path, "EXR"):
        return data, _checked(read_layout(data), path)


def _checked(layout: Layout, path: str | Path) -> Layout:
    """`layout`; `InputError` where its pixels are more than the bytes of the file can hold."""
    for part in layout.parts:
        samples = float(part.width) * part.height * len(part.channels)
        check_density(LEAST_BYTES * samples, Path(path), PACKED, f"{part.width} × {part.height} pixels")
    return layout


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
