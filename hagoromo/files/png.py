"""PNG: images of 8 or 16 bits, as the file has them, with channels in the order R, G, B, A."""

from __future__ import annotations

import base64
import struct
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.apart import read_apart
from hagoromo.files.checks import DEFLATE, check_density, existing_file, read_bytes
from hagoromo.files.memory import require
from hagoromo.files.reading import opencv_silenced, reading
from hagoromo.files.whole import write_bytes

SIGNATURE = b"\x89PNG\r\n\x1a\n"
DEPTHS = {0: (1, 2, 4, 8, 16), 2: (8, 16), 3: (1, 2, 4, 8), 4: (8, 16), 6: (8, 16)}  # of each colour type
CHANNELS = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}
PALETTE = 3  # colour type
HEADER_CHUNK = b"\0\0\0\x0dIHDR"  # its length and type
AFTER_HEADER = len(SIGNATURE) + 25  # bytes: behind IHDR
LONGEST_SIDE, MOST_PIXELS = 1_000_000, 1 << 30  # what OpenCV decodes
PIXEL_CHUNKS = (b"IHDR", b"PLTE", b"tRNS", b"IDAT", b"IEND")  # in their order
ADAM7 = ((0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4), (1, 0, 2, 2), (0, 1, 1, 2))
LAST_FILTER = 4  # Paeth's
PIECE = 1 << 20  # bytes that are unpacked at a time


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
    xmp: str = "",
) -> None:
    """Write `image`: (height, width), (height, width, 3) or (height, width, 4), uint8 or uint16.

    srgb: say in the file that its colours are sRGB's, so that other programs show them so. profile: an ICC profile that
    says it of another display. xmp: a packet of metadata (ISO 16684-1).
    """
    write_bytes(path, png_bytes(image, srgb, profile, xmp))


def png_bytes(
    image: NDArray[np.uint8] | NDArray[np.uint16], srgb: bool = False, profile: bytes | None = None, xmp: str = ""
) -> bytes:
    """The content of a PNG file of `image`: (height, width), (height, width, 3) or (…, 4), uint8 or uint16.

    srgb, profile, xmp: as of `write_png`.
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
    if xmp:
        stated += _chunk(b"iTXt", XMP_KEYWORD + bytes(5) + xmp.encode())  # neither packed nor in a language
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


def pixels_by_opencv(path: Path) -> Mapping[str, NDArray[np.uint8] | NDArray[np.uint16]]:
    """pixels: (height, width[, 3 or 4]), in the order R, G, B, A; run by `read_apart`.

    OpenCV is given nothing that its libpng would find wrong.
    """
    import cv2

    data = _checked_chunks(read_bytes(path), png_header(path), path)
    with reading(path, "PNG"), opencv_silenced():
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None:
        raise InputError(f"{path} cannot be decoded as PNG: make it anew")
    return {"pixels": swapped(image)}


def _checked_chunks(data: bytes, header: PngHeader, path: Path) -> bytes:
    """The chunks that make the pixels, all check sums verified.

    OpenCV decodes a truncated file without an error, and its libpng prints what it finds wrong; it is given nothing
    that libpng would find wrong. The other chunks (colour profiles, texts) are left out.
    """
    offset, kind, kept = len(SIGNATURE), b"", []
    while kind != b"IEND":
        length, kind = struct.unpack_from(">I4s", data, offset) if offset + 12 <= len(data) else (len(data), b"")
        end = offset + 12 + length
        if end > len(data):
            raise InputError(f"{path} is cut off: copy it again")
        if zlib.crc32(data[offset + 4 : end - 4]) != struct.unpack_from(">I", data, end - 4)[0]:
            raise InputError(f"{path} is damaged (check sum of chunk {kind!r}): copy it again")
        if kind in PIXEL_CHUNKS:
            kept.append((kind, offset, end))
        offset = end
    order = [kind for kind, _, _ in kept]
    if order[:1] != [b"IHDR"] or order != sorted(order, key=PIXEL_CHUNKS.index) or b"IDAT" not in order:
        raise InputError(f"{path} is damaged (its chunks are not those of a PNG): copy it again")
    if any(order.count(kind) > 1 for kind in (b"IHDR", b"PLTE", b"tRNS")):
        raise InputError(f"{path} is damaged (a chunk is there twice): copy it again")
    parts = {kind: data[start + 8 : end - 4] for kind, start, end in kept if kind != b"IDAT"}
    packed = [data[start + 8 : end - 4] for kind, start, end in kept if kind == b"IDAT"]
    kinds = _check_pixels(header, parts, packed, path)
    return SIGNATURE + b"".join(data[start:end] for kind, start, end in kept if kind in kinds)


def _check_pixels(header: PngHeader, parts: Mapping[bytes, bytes], packed: Sequence[bytes], path: Path) -> set[bytes]:
    """Check palette and packed lines (W3C PNG, third edition, 11.2); gives the kinds of chunk to decode."""
    depth, colour = header.depth, header.colour
    palette, clear = len(parts.get(b"PLTE", b"")), len(parts.get(b"tRNS", b""))
    if colour == PALETTE and (palette % 3 or not 3 <= palette <= 3 << depth or clear > palette // 3):
        raise InputError(f"{path} has a palette of {palette} bytes at {depth} bits: it is damaged")
    lines = _lines(header)
    try:
        _check_lines(packed, lines)
    except (ValueError, zlib.error) as error:
        raise InputError(f"{path} has damaged pixels ({error}): copy it again") from error
    clears = clear == {0: 2, 2: 6}.get(colour, clear if colour == PALETTE else 0) and clear > 0
    return {b"IHDR", b"IDAT", b"IEND", *([b"PLTE"] if colour == PALETTE else []), *([b"tRNS"] if clears else [])}


def _lines(header: PngHeader) -> list[tuple[int, int]]:
    """(bytes with the filter's, count) of the lines of each pass."""
    passes = ADAM7 if header.interlaced else ((0, 0, 1, 1),)
    sizes = ((-(-(header.width - x) // dx), -(-(header.height - y) // dy)) for x, y, dx, dy in passes)
    return [(1 + (across * header.bits + 7) // 8, down) for across, down in sizes if across > 0 and down > 0]


def _check_lines(packed: Sequence[bytes], lines: Sequence[tuple[int, int]]) -> None:
    """Unpack all lines, a part at a time; ValueError unless they are complete and every filter is known."""
    unpacker, ends = zlib.decompressobj(), np.cumsum([size * count for size, count in lines])
    begins, at, seen = ends - [size * count for size, count in lines], 0, 0
    for part in packed:
        waiting = part
        while waiting:
            piece = unpacker.decompress(waiting, PIECE)
            waiting = unpacker.unconsumed_tail
            end = seen + len(piece)
            if end > ends[-1]:
                raise ValueError("there are more than its header says")
            while at < len(lines) and begins[at] < end:
                size = lines[at][0]
                first = begins[at] + max(-(-(seen - begins[at]) // size), 0) * size
                filters = np.frombuffer(piece, np.uint8)[first - seen : min(ends[at], end) - seen : size]
                if filters.size and filters.max() > LAST_FILTER:
                    raise ValueError("a line has an unknown filter")
                if ends[at] > end:
                    break
                at += 1
            seen = end
            if unpacker.eof:
                break
    if seen != ends[-1] or not unpacker.eof:
        raise ValueError("there are fewer than its header says")
    if unpacker.unused_data:
        raise ValueError("there is more behind them")


# sRGB with the rendering intent perceptual; for programs that do not know it, gamma and primaries (PNG, 11.3.2.5)
XMP_KEYWORD = b"XML:com.adobe.xmp"
SRGB_CHUNKS = (
    _chunk(b"sRGB", b"\0")
    + _chunk(b"gAMA", struct.pack(">I", 45455))
    + _chunk(b"cHRM", struct.pack(">8I", 31270, 32900, 64000, 33000, 30000, 60000, 15000, 6000))
)
