"""PNG: images of 8 or 16 bits, as the file has them, with channels in the order R, G, B, A."""

from __future__ import annotations

import base64
import struct
import zlib
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.apart import read_apart
from hagoromo.files.checks import DEFLATE, check_density, existing_file
from hagoromo.files.memory import require
from hagoromo.files.whole import write_bytes

SIGNATURE = b"\x89PNG\r\n\x1a\n"
DEPTHS = {0: (1, 2, 4, 8, 16), 2: (8, 16), 3: (1, 2, 4, 8), 4: (8, 16), 6: (8, 16)}  # of each colour type
CHANNELS = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}
PALETTE = 3  # colour type
HEADER_CHUNK = b"\0\0\0\x0dIHDR"  # its length and type
AFTER_HEADER = len(SIGNATURE) + 25  # bytes: behind IHDR
LONGEST_SIDE, MOST_PIXELS = 1_000_000, 1 << 30  # what OpenCV decodes


class PngHeader(NamedTuple):
    """width, height [px]; depth: bits of a sample; colour: its type, of CHANNELS."""

    width: int
    height: int
    depth: int
    colour: int
    interlaced: bool

    @property
    def bits(self) -> int:
        """Bits of a pixel."""
        return self.depth * CHANNELS[self.colour]


def write_png(
    path: str | Path,
    image: NDArray[np.uint8] | NDArray[np.uint16],
    srgb: bool = False,
    profile: bytes | None = None,
) -> None:
    """Write `image`: (height, width), (height, width, 3) or (height, width, 4), uint8 or uint16.

    srgb: say in the file that its colours are sRGB's, so that other programs show them so. profile: an ICC profile that
    says it of another display.
    """
    write_bytes(path, png_bytes(image, srgb, profile))


def png_bytes(image: NDArray[np.uint8] | NDArray[np.uint16], srgb: bool = False, profile: bytes | None = None) -> bytes:
    """The content of a PNG file of `image`: (height, width), (height, width, 3) or (…, 4), uint8 or uint16.

    srgb, profile: as of `write_png`.
    """
    import cv2

    if image.dtype not in (np.uint8, np.uint16):
        raise InputError(f"a PNG holds uint8 or uint16: given {image.dtype}")
    if image.ndim not in (2, 3) or image.size == 0 or (image.ndim == 3 and image.shape[2] not in (3, 4)):
        raise InputError(f"a PNG is (height, width), with 3 or 4 channels if any: given shape {image.shape}")
    done, encoded = cv2.imencode(".png", swapped(image))
    if not done:
        raise OSError(f"an image of shape {image.shape} could not be encoded as PNG")
    data = encoded.tobytes()
    stated = SRGB_CHUNKS if srgb else b"" if profile is None else _chunk(b"iCCP", b"ICC\0\0" + zlib.compress(profile))
    return data[:AFTER_HEADER] + stated + data[AFTER_HEADER:]


def _chunk(kind: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))


def png_data_uri(image: NDArray[np.uint8] | NDArray[np.uint16]) -> str:
    """`image`, as `write_png` takes it, as the text of the `src` of an HTML <img>."""
    return f"data:image/png;base64,{base64.b64encode(png_bytes(image)).decode()}"


def read_png(path: str | Path) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """The image: (height, width[, 3 or 4]), uint8 or uint16 as in the file; decoded in a process apart.

    `InputError` if the file is missing, not a PNG, truncated, damaged, or larger than the free memory.
    """
    from hagoromo.files.png_pixels import pixels_by_opencv

    header = png_header(path)
    as_decoded = {PALETTE: 4, 4: 4}.get(header.colour, CHANNELS[header.colour])
    size = float(header.width * header.height * as_decoded * (2 if header.depth > 8 else 1))
    require(2.0 * size, str(path))
    return read_apart(pixels_by_opencv, path, "PNG", stated=size)["pixels"]


def png_header(path: str | Path) -> PngHeader:
    """What the header of a PNG states; `InputError` for one that no PNG has, or more pixels than its bytes can hold."""
    file = existing_file(path)
    with file.open("rb") as opened:
        start = opened.read(AFTER_HEADER)
    if not start.startswith(SIGNATURE):
        raise InputError(f"{path} is not a PNG file: give a PNG")
    if len(start) < AFTER_HEADER or start[8:16] != HEADER_CHUNK:
        raise InputError(f"{path} is cut off, or damaged in its header: copy it again")
    width, height, depth, colour, *methods = struct.unpack(">IIBBBBB", start[16:29])
    if depth not in DEPTHS.get(colour, ()) or methods[:2] != [0, 0] or methods[2] > 1:
        raise InputError(f"{path} has a header that no PNG has (depth {depth}, colour type {colour}): it is damaged")
    if not (0 < width <= LONGEST_SIDE and 0 < height <= LONGEST_SIDE and width * height <= MOST_PIXELS):
        raise InputError(
            f"{path} is {width} × {height} pixels: 1 to {LONGEST_SIDE} a side and {MOST_PIXELS} in all are read"
        )
    header = PngHeader(width, height, depth, colour, bool(methods[2]))
    check_density(width * height * header.bits / 8.0, file, DEFLATE, f"{width} × {height} pixels")
    return header


def exif_chunk(data: bytes) -> bytes | None:
    """The TIFF in the eXIf chunk of a PNG; None if there is none."""
    offset = len(SIGNATURE)
    while offset + 12 <= len(data):
        length, kind = struct.unpack_from(">I4s", data, offset)
        if kind == b"eXIf":
            return data[offset + 8 : offset + 8 + length]
        offset += 12 + length
    return None


def swapped(image: NDArray) -> NDArray:
    """R, G, B ↔ B, G, R (OpenCV's order); alpha stays last."""
    if image.ndim == 2:
        return image
    return np.ascontiguousarray(image[..., [2, 1, 0, 3][: image.shape[2]]])


# sRGB with the rendering intent perceptual; for programs that do not know it, gamma and primaries (PNG, 11.3.2.5)
SRGB_CHUNKS = (
    _chunk(b"sRGB", b"\0")
    + _chunk(b"gAMA", struct.pack(">I", 45455))
    + _chunk(b"cHRM", struct.pack(">8I", 31270, 32900, 64000, 33000, 30000, 60000, 15000, 6000))
)
