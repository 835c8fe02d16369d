"""The pixels of a PNG, by OpenCV, which is given nothing that its libpng would find wrong; run by `read_apart`."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.checks import read_bytes
from hagoromo.files.png import PALETTE, SIGNATURE, PngHeader, png_header, swapped
from hagoromo.files.reading import reading
from hagoromo.files.silence import opencv_silenced

PIXEL_CHUNKS = (b"IHDR", b"PLTE", b"tRNS", b"IDAT", b"IEND")  # in their order
ADAM7 = ((0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4), (1, 0, 2, 2), (0, 1, 1, 2))
LAST_FILTER = 4  # Paeth's
PIECE = 1 << 20  # bytes that are unpacked at a time


def pixels_by_opencv(path: Path) -> Mapping[str, NDArray[np.uint8] | NDArray[np.uint16]]:
    """pixels: (height, width[, 3 or 4]), in the order R, G, B, A."""
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
