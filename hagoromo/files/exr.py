"""OpenEXR: named float32 channels with text metadata."""

from __future__ import annotations

import os
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.checks import existing_file
from hagoromo.files.memory import require
from hagoromo.files.silence import silenced
from hagoromo.files.whole import check_written, whole_file

MAGIC = b"\x76\x2f\x31\x01"
LINES_TOGETHER = 16  # that ZIP packs
BYTES_PER_SAMPLE = 8.0  # as the file has it, up to 4, and as float32


def write_exr(path: str | Path, channels: Mapping[str, NDArray], metadata: Mapping[str, str] | None = None) -> None:
    """Write `channels`, name → (height, width), as float32 with lossless compression.

    `InputError` when there is no channel or their shapes differ.
    """
    import OpenEXR

    arrays = {name: np.ascontiguousarray(values, dtype=np.float32) for name, values in channels.items()}
    shapes = sorted({values.shape for values in arrays.values()})
    if len(shapes) != 1 or len(shapes[0]) != 2 or 0 in shapes[0]:
        raise InputError(f"the channels of an EXR have shapes {shapes}: give one shape (height, width) for all")
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
    source = existing_file(path)
    with source.open("rb") as file:
        if file.read(4) != MAGIC:
            raise InputError(f"{source} is not an EXR file: give an EXR")
    header = _open(source, header_only=True).header()
    return {name: value for name, value in header.items() if isinstance(value, str)}


def read_exr(path: str | Path) -> tuple[dict[str, NDArray[np.float32]], dict[str, str]]:
    """Channels, name → (height, width) float32, and the text metadata of the first part.

    `InputError` if the file is missing, not an EXR, truncated, or larger than the free memory.
    """
    source = existing_file(path)
    with source.open("rb") as file:
        if file.read(4) != MAGIC:
            raise InputError(f"{source} is not an EXR file: give an EXR")
    require(sum(_pixel_bytes(part.header) for part in _open(source, header_only=True).parts), str(source))
    part = _open(source)
    channels = {name: np.asarray(channel.pixels, dtype=np.float32) for name, channel in part.channels().items()}
    text = {name: value for name, value in part.header().items() if isinstance(value, str)}
    return channels, text


def _pixel_bytes(header: Mapping[str, Any]) -> float:
    """Memory [byte] of the pixels of a part, as they are read and as float32: the library reads all parts."""
    (left, top), (right, bottom) = (map(float, corner) for corner in header["dataWindow"])
    rows_together = header["tiles"].ySize if "tiles" in header else LINES_TOGETHER
    across, down = max(right - left, 0.0) + 1.0, max(bottom - top, 0.0) + rows_together
    return BYTES_PER_SAMPLE * across * down * len(header["channels"])


def _open(path: Path, header_only: bool = False) -> Any:
    import OpenEXR

    try:
        with silenced():
            file = OpenEXR.File(str(path), separate_channels=True, header_only=header_only)
    except (RuntimeError, ValueError, MemoryError) as error:
        raise InputError(f"{path} cannot be read as EXR, it may be cut off: {_one_line(error)}") from error
    if not file.parts:
        raise InputError(f"{path} cannot be read as EXR: it is cut off or damaged: copy it again")
    return file


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())
