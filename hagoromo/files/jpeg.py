"""JPEG: 8-bit photographs, as in captures of other programs. Read only, because JPEG is lossy."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.checks import read_bytes
from hagoromo.files.memory import require
from hagoromo.files.reading import reading

START, END = b"\xff\xd8\xff", b"\xff\xd9"
JPEG_BYTES_PER_PIXEL = 6  # two copies of 3 bytes while decoding
COEFFICIENT_BYTES_PER_PIXEL = 6  # of a progressive file, which is kept whole
PROGRESSIVE = (0xC2, 0xC6, 0xCA, 0xCE)  # markers of their frames


def read_jpeg(path: str | Path) -> NDArray[np.uint8]:
    """The image as stored, not rotated upright: (height, width) grey or (height, width, 3) in the order R, G, B.

    `InputError` if the file is missing, not a JPEG, truncated, damaged, or larger than the free memory.
    """
    from PIL.JpegImagePlugin import JpegImageFile

    data = read_bytes(path)
    if not data.startswith(START):
        raise InputError(f"{path} is not a JPEG file: give a JPEG")
    height, width, frame = frame_header(data, path)
    if END not in data[frame:]:  # some cameras append data after it; a thumbnail before the frame has its own
        raise InputError(f"{path} is cut off: copy it again")
    kept = COEFFICIENT_BYTES_PER_PIXEL if data[frame + 1] in PROGRESSIVE else 0
    require(float(JPEG_BYTES_PER_PIXEL + kept) * height * width, str(path))
    with reading(path, "JPEG"):
        # Pillow's libjpeg prints nothing; its own check of sizes is in Image.open, and ours is above
        picture = JpegImageFile(io.BytesIO(data))
        if picture.size != (width, height):
            raise InputError(f"{path} is a damaged JPEG: copy it again")
        picture.load()
        return np.array(picture if picture.mode == "L" else picture.convert("RGB"), np.uint8)


def frame_header(data: bytes, path: str | Path) -> tuple[int, int, int]:
    """Height, width and byte offset of the frame header, the first segment SOF0–SOF15 (ITU-T T.81, B.2.2)."""
    offset = 2
    while offset + 9 <= len(data) and data[offset] == 0xFF:
        marker, length = data[offset + 1], int.from_bytes(data[offset + 2 : offset + 4], "big")
        if marker in range(0xC0, 0xD0) and marker not in (0xC4, 0xC8, 0xCC):
            return (
                int.from_bytes(data[offset + 5 : offset + 7], "big"),
                int.from_bytes(data[offset + 7 : offset + 9], "big"),
                offset,
            )
        offset += 2 + length
    raise InputError(f"{path} is a damaged JPEG: copy it again")


def exif_segment(data: bytes) -> bytes | None:
    """The TIFF in the EXIF segment (APP1) of a JPEG; None if there is none."""
    offset = 2
    while offset + 4 <= len(data) and data[offset] == 0xFF and data[offset + 1] != 0xDA:  # up to the start of the scan
        length = int.from_bytes(data[offset + 2 : offset + 4], "big")
        if data[offset + 1] == 0xE1 and data[offset + 4 : offset + 10] == b"Exif\0\0":
            return data[offset + 10 : offset + 2 + length]
        offset += 2 + length
    return None
