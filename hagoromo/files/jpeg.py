"""JPEG: 8-bit photographs, as in captures of other programs. Read only, because JPEG is lossy."""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.apart import read_apart
from hagoromo.files.checks import check_density, existing_file, read_bytes
from hagoromo.files.memory import require
from hagoromo.files.reading import reading

START, END = b"\xff\xd8\xff", b"\xff\xd9"
JPEG_BYTES_PER_PIXEL = 6  # two copies of 3 bytes while decoding
COEFFICIENT_BYTES_PER_PIXEL = 6  # of a progressive file, which is kept whole
PROGRESSIVE = (0xC2, 0xC6, 0xCA, 0xCE)  # markers of their frames
FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}  # SOF0–SOF15
MOST_PIXELS_PER_BYTE = 1024.0  # a block of 8 × 8 pixels takes one bit or more: 512


class Frame(NamedTuple):
    """height, width [px]; channels; progressive; offset: of its header in the file."""

    height: int
    width: int
    channels: int
    progressive: bool
    offset: int


def read_jpeg(path: str | Path) -> NDArray[np.uint8]:
    """The image as stored, not rotated upright: (height, width) grey or (height, width, 3) in the order R, G, B.

    Decoded in a process apart. `InputError` if the file is missing, not a JPEG, truncated, damaged, or larger than the
    free memory.
    """
    frame = frame_header(path)
    kept = COEFFICIENT_BYTES_PER_PIXEL if frame.progressive else 0
    pixels = float(frame.height * frame.width)
    require((JPEG_BYTES_PER_PIXEL + kept) * pixels, str(path))
    return read_apart(pixels_by_pillow, path, "JPEG", stated=frame.channels * pixels)["pixels"]


def frame_header(path: str | Path) -> Frame:
    """The frame header, the first segment SOF0–SOF15 (ITU-T T.81, B.2.2); nothing else of the file is read.

    `InputError` where there is none, and for more pixels than the bytes of the file can hold.
    """
    file = existing_file(path)
    with file.open("rb") as opened:
        if not opened.read(len(START)).startswith(START):
            raise InputError(f"{path} is not a JPEG file: give a JPEG")
        offset = 2
        while len(segment := _at(opened, offset, 10)) == 10 and segment[0] == 0xFF:
            marker, length = segment[1], int.from_bytes(segment[2:4], "big")
            if marker in FRAMES:
                height, width = (int.from_bytes(segment[k : k + 2], "big") for k in (5, 7))
                check_density(height * width, file, MOST_PIXELS_PER_BYTE, f"{width} × {height} pixels")
                return Frame(height, width, segment[9], marker in PROGRESSIVE, offset)
            offset += 2 + length
    raise InputError(f"{path} is a damaged JPEG: copy it again")


def pixels_by_pillow(path: Path) -> Mapping[str, NDArray[np.uint8]]:
    """pixels, as of `read_jpeg`, by which it is run apart."""
    from PIL.JpegImagePlugin import JpegImageFile

    frame, data = frame_header(path), read_bytes(path)
    if END not in data[frame.offset :]:  # some cameras append data after it; a thumbnail before the frame has its own
        raise InputError(f"{path} is cut off: copy it again")
    with reading(path, "JPEG"):
        # Pillow's libjpeg prints nothing; its own check of sizes is in Image.open, and ours is in `read_jpeg`
        picture = JpegImageFile(io.BytesIO(data))
        if picture.size != (frame.width, frame.height):
            raise InputError(f"{path} is a damaged JPEG: copy it again")
        picture.load()
        return {"pixels": np.asarray(picture if picture.mode == "L" else picture.convert("RGB"), np.uint8)}


def exif_segment(data: bytes) -> bytes | None:
    """The TIFF in the EXIF segment (APP1) of a JPEG; None if there is none."""
    offset = 2
    while offset + 4 <= len(data) and data[offset] == 0xFF and data[offset + 1] != 0xDA:  # up to the start of the scan
        length = int.from_bytes(data[offset + 2 : offset + 4], "big")
        if data[offset + 1] == 0xE1 and data[offset + 4 : offset + 10] == b"Exif\0\0":
            return data[offset + 10 : offset + 2 + length]
        offset += 2 + length
    return None


def _at(opened: io.BufferedReader, offset: int, size: int) -> bytes:
    opened.seek(offset)
    return opened.read(size)
