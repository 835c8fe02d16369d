"""OpenEXR: named float32 channels with text metadata."""

from __future__ import annotations

import os
import struct
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.apart import read_apart
from hagoromo.files.checks import existing_file, read_bytes
from hagoromo.files.exr_lines import MAGIC, Layout, Part, read_layout, read_lines
from hagoromo.files.finite import check_finite
from hagoromo.files.memory import require
from hagoromo.files.reading import reading
from hagoromo.files.whole import check_written, whole_file

HEADER_BYTES = 1 << 18  # first bytes of a file that are read for its header alone
LINES_TOGETHER = 16  # that ZIP packs
BYTES_PER_SAMPLE = 8.0  # as the file has it, up to 4, and as float32
PREFIX = "channel "  # of names of channels among those of arrays


def write_exr(
    path: str | Path, channels: Mapping[str, NDArray], metadata: Mapping[str, str] | None = None, half: bool = False
) -> None:
    """Write `channels`, name → (height, width), as float32 (or half floats) with lossless compression.

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
    header = {**(metadata or {}), "compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with whole_file(path, force=True) as partial:
        try:
            with OpenEXR.File(header, arrays) as file:
                file.write(str(partial))
        except RuntimeError:  # of a write that failed
            check_written(partial, path, whole=False)
        check_written(partial, path, _is_whole(partial, shapes[0][0]))


def _is_whole(path: Path, height: int) -> bool:
    """Whether an EXR that `write_exr` wrote has all its lines: the library does not tell where the disk was full."""
    size = path.stat().st_size if path.exists() else 0
    with path.open("rb") as file:
        file.seek(len(MAGIC) + 4)
        while _text(file):  # name, type, size and value of an attribute; an empty name ends them
            _text(file)
            file.seek(struct.unpack("<i", file.read(4).ljust(4, b"\0"))[0], os.SEEK_CUR)
        parts = -(-height // LINES_TOGETHER)
        places = struct.unpack(f"<{parts}Q", file.read(8 * parts).ljust(8 * parts, b"\0"))
        file.seek(max(places) + 4)
        last = struct.unpack("<i", file.read(4).ljust(4, b"\0"))[0]
    return min(places) > 0 and last > 0 and max(places) + 8 + last == size


def _text(file: BinaryIO) -> bytes:
    """The bytes before the next zero."""
    return b"".join(iter(lambda: file.read(1).strip(b"\0"), b""))


def read_header(path: str | Path) -> dict[str, str]:
    """The text metadata of the first part; `InputError` if the file is missing or not an EXR."""
    with existing_file(path).open("rb") as file:
        start = file.read(HEADER_BYTES)
    if len(start) == HEADER_BYTES and start.startswith(MAGIC):
        with suppress(Exception):  # a header that is longer, or damaged: the whole file tells
            return read_layout(start).parts[0].texts
    return _layout(path)[1].parts[0].texts


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
        return data, read_layout(data)
