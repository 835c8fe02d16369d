"""PNG: images of 8 or 16 bits, as the file has them, with channels in the order R, G, B, A."""

from __future__ import annotations

import base64
import struct
import zlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.checks import read_bytes
from hagoromo.files.memory import require
from hagoromo.files.whole import write_bytes

CHANNELS = {0: 1, 2: 3, 3: 4}  # of the kinds of pixel: grey, colours, palette (as it is decoded); others have 4
SIGNATURE = b"\x89PNG\r\n\x1a\n"


def write_png(path: str | Path, image: NDArray[np.uint8] | NDArray[np.uint16]) -> None:
    """Write `image`: (height, width), (height, width, 3) or (height, width, 4), uint8 or uint16."""
    write_bytes(path, png_bytes(image))


def png_bytes(image: NDArray[np.uint8] | NDArray[np.uint16]) -> bytes:
    """The content of a PNG file of `image`: (height, width), (height, width, 3) or (…, 4), uint8 or uint16."""
    import cv2

    if image.dtype not in (np.uint8, np.uint16):
        raise InputError(f"a PNG holds uint8 or uint16: given {image.dtype}")
    if image.ndim not in (2, 3) or image.size == 0 or (image.ndim == 3 and image.shape[2] not in (3, 4)):
        raise InputError(f"a PNG is (height, width), with 3 or 4 channels if any: given shape {image.shape}")
    done, encoded = cv2.imencode(".png", _swapped(image))
    if not done:
        raise OSError(f"an image of shape {image.shape} could not be encoded as PNG")
    return encoded.tobytes()


def png_data_uri(image: NDArray[np.uint8] | NDArray[np.uint16]) -> str:
    """`image`, as `write_png` takes it, as the text of the `src` of an HTML <img>."""
    return f"data:image/png;base64,{base64.b64encode(png_bytes(image)).decode()}"


def read_png(path: str | Path) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """The image: (height, width[, 3 or 4]), uint8 or uint16 as in the file.

    `InputError` if the file is missing, not a PNG, truncated, damaged, or larger than the free memory.
    """
    import cv2

    data = read_bytes(path)
    _check_chunks(data, path)
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None:
        raise InputError(f"{path} cannot be decoded as PNG: make it anew")
    return _swapped(image)


def exif_chunk(data: bytes) -> bytes | None:
    """The TIFF in the eXIf chunk of a PNG; None if there is none."""
    offset = len(SIGNATURE)
    while offset + 12 <= len(data):
        length, kind = struct.unpack_from(">I4s", data, offset)
        if kind == b"eXIf":
            return data[offset + 8 : offset + 8 + length]
        offset += 12 + length
    return None


def _swapped(image: NDArray) -> NDArray:
    """R, G, B ↔ B, G, R (OpenCV's order); alpha stays last."""
    if image.ndim == 2:
        return image
    return np.ascontiguousarray(image[..., [2, 1, 0, 3][: image.shape[2]]])


def _check_chunks(data: bytes, path: str | Path) -> None:
    """Verify all chunks and their check sums, because OpenCV decodes a truncated file without an error."""
    if not data.startswith(SIGNATURE):
        raise InputError(f"{path} is not a PNG file: give a PNG")
    offset, kind = len(SIGNATURE), b""
    while kind != b"IEND":
        if offset + 12 > len(data):
            raise InputError(f"{path} is cut off: copy it again")
        length, kind = struct.unpack_from(">I4s", data, offset)
        if offset + 12 + length > len(data):
            raise InputError(f"{path} is cut off: copy it again")
        if zlib.crc32(data[offset + 4 : offset + 8 + length]) != struct.unpack_from(">I", data, offset + 8 + length)[0]:
            raise InputError(f"{path} is damaged (check sum of chunk {kind!r}): copy it again")
        if kind == b"IHDR":
            width, height, bits, kind_of_pixel = struct.unpack_from(">IIBB", data, offset + 8)
            pixel = CHANNELS.get(kind_of_pixel, 4) * (2 if bits > 8 else 1)
            require(2.0 * width * height * pixel, str(path))
        offset += 12 + length
