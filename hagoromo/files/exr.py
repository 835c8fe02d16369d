"""OpenEXR: named float32 channels with text metadata."""

from __future__ import annotations

import os
import struct
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.apart import read_apart
from hagoromo.files.checks import PACKED, check_density, existing_file, read_bytes
from hagoromo.files.exr_lines import MAGIC, Layout, Part, read_layout, read_lines
from hagoromo.files.finite import check_finite
from hagoromo.files.memory import require
from hagoromo.files.reading import reading
from hagoromo.files.whole import check_written, whole_file

HEADER_BYTES = 1 << 18  # first bytes of a file that are read for its header alone
LINES_TOGETHER = 16  # that ZIP packs
LEAST_BYTES = 2.0  # of a sample in the file, a half float
BYTES_PER_SAMPLE = 8.0  # as the file has it, up to 4, and as float32
PREFIX = "channel "  # of names of channels among those of arrays


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
    """Whether an EXR that `write_exr` wrote has all its chunks: the library does not tell where the disk was full."""
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
        with suppress(Exception):  # a header that is longer, or damaged: the whole file tells
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
