"""Pictures as cameras and other tools leave them: PNG or JPEG, told apart by their first bytes."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.door import check_memory, read_bytes
from hagoromo.files.png import SIGNATURE, read_png

JPEG_START, JPEG_END = b"\xff\xd8", b"\xff\xd9"
SCAN, FRAMES = 0xDA, {0xC0, 0xC1, 0xC2}  # markers: start of scan; frame headers of baseline and progressive JPEG


def read_picture(path: str | Path) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """The stored pixels: (height, width[, 3 or 4]), uint8 or uint16, in the order R, G, B, A; never rotated.

    `InputError` when the file is missing, neither PNG nor JPEG, cut off, or larger than the free memory.
    """
    data = read_bytes(path)
    if data.startswith(SIGNATURE):
        return read_png(path)
    if data.startswith(JPEG_START):
        return _decode_jpeg(data, path)
    raise InputError(f"{path} is neither PNG nor JPEG: convert it")


def _decode_jpeg(data: bytes, path: str | Path) -> NDArray[np.uint8]:
    import cv2

    _check_segments(data, path)
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None:
        raise InputError(f"{path} cannot be decoded as JPEG: convert it")
    return np.ascontiguousarray(image[..., ::-1] if image.ndim == 3 else image).astype(np.uint8, copy=False)


def _check_segments(data: bytes, path: str | Path) -> None:
    """Walk the segments to the scan, which must have an end: OpenCV fills what is missing with grey."""
    at, marker = 2, 0
    while marker != SCAN:
        if at + 9 > len(data) or data[at] != 0xFF:
            raise InputError(f"{path} is a JPEG that is cut off or damaged: copy it again")
        marker, length = struct.unpack_from(">xBH", data, at)
        if marker in FRAMES:
            height, width = struct.unpack_from(">HH", data, at + 5)
            check_memory(3.0 * height * width, str(path))
        at += 2 + length
    if JPEG_END not in data[at:]:
        raise InputError(f"{path} is a JPEG that is cut off: copy it again")
