"""ICC profiles of files: what numbers in another colour space than sRGB are in sRGB.

Profiles of three primaries and curves (ICC.1:2022, 8.3.3) are applied, as Adobe RGB, Display P3 and ProPhoto have them;
others (tables, grey, CMYK) are refused.

ICC profile: what says in a PNG or TIFF which colours its numbers are, for displays of three primaries under D65.

A matrix and a curve (ICC.1:2022, 8.3.3), made here, as LittleCMS in Pillow makes that of sRGB only.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files import jpeg, png
from hagoromo.files.checks import existing_file, read_bytes
from hagoromo.files.reading import reading, tifffile_silenced

TIFF = (b"II*\0", b"MM\0*")
TAG_OF_TIFF, JPEG_NAME, JPEG_HEAD = 34675, b"ICC_PROFILE\0", 18
LARGEST = 1 << 22  # bytes of a profile
SAME = 2.0 / 255.0  # largest difference of display values that is called none: two profiles of sRGB differ by rounding
Curve = Callable[[NDArray[np.float64]], NDArray[np.float64]]
SRGB, DISPLAY_P3 = "sRGB", "Display P3"
PRIMARIES = {  # x, y of red, green, blue: IEC 61966-2-1; SMPTE EG 432-1
    SRGB: ((0.64, 0.33), (0.30, 0.60), (0.15, 0.06)),
    DISPLAY_P3: ((0.68, 0.32), (0.265, 0.69), (0.15, 0.06)),
}
D65 = (0.3127, 0.3290)
D50 = np.array([0.9642, 1.0, 0.8249])  # X, Y, Z of the white of profiles (ICC.1:2022, 6.3.4.3)
# cones of chromatic adaptation, "Bradford" (ICC.1:2022, annex E)
BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])
CURVE = (2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045)  # of sRGB: g, a, b, c, d of ICC.1:2022, table 68, type 3


def linear_by_profile(path: str | Path, values: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Linear sRGB of display values (height, width, 3) in 0…1 by the profile in their file.

    None where it has none, or that of sRGB. `InputError` for one that is damaged or of another kind.
    """
    profile = embedded_profile(path)
    if profile is None or values.shape[2] != 3:
        return None
    with reading(path, "ICC profile"):
        return linear_by(profile, values, str(path))


def linear_by(profile: bytes, values: NDArray[np.float64], where: str) -> NDArray[np.float64] | None:
    """Linear sRGB of display values by an ICC profile; None if it is sRGB's."""
    own = _matrix_and_curves(profile)
    if own is None:
        raise InputError(f"{where} has a colour profile of tables, grey or CMYK, which is not applied: make it sRGB")
    of_srgb = _matrix_and_curves(icc_profile(SRGB))
    assert of_srgb is not None
    matrix = np.linalg.solve(of_srgb[0], own[0])
    ramp = np.linspace(0.0, 1.0, 18)[1:]
    same = np.abs(matrix - np.eye(3)).max() < SAME and all(
        np.abs(a(ramp) / b(ramp) - 1.0).max() < 2.0 * SAME for a, b in zip(own[1], of_srgb[1], strict=True)
    )
    if same:
        return None
    linear = np.stack([curve(values[..., k]) for k, curve in enumerate(own[1])], axis=-1) @ matrix.T
    if not np.isfinite(linear).all():
        raise ValueError("its curves are not finite")
    return linear


def embedded_profile(path: str | Path) -> bytes | None:
    """The ICC profile within a PNG, JPEG or TIFF; None where there is none."""
    file = existing_file(path)
    with file.open("rb") as opened:
        start = opened.read(8)
    with reading(path, "ICC profile"):
        if start.startswith(TIFF):
            import tifffile

            with tifffile_silenced(), tifffile.TiffFile(file) as tiff:
                tag = tiff.pages.first.tags.get(TAG_OF_TIFF)
                return None if tag is None or tag.count > LARGEST else bytes(tag.value)
        if start.startswith(png.SIGNATURE):
            return _of_png(read_bytes(file))
        return _of_jpeg(read_bytes(file)) if start.startswith(jpeg.START) else None


def _of_png(data: bytes) -> bytes | None:
    at = len(png.SIGNATURE)
    while at + 12 <= len(data):
        length, kind = struct.unpack_from(">I4s", data, at)
        if kind == b"IDAT":
            return None
        if kind == b"iCCP":
            packed = data[at + 8 : at + 8 + length].partition(b"\0")[2][1:]
            return zlib.decompressobj().decompress(packed, LARGEST)
        at += 12 + length
    return None


def _of_jpeg(data: bytes) -> bytes | None:
    parts, at = {}, 2
    while at + 4 <= len(data) and data[at] == 0xFF and data[at + 1] != 0xDA:
        length = int.from_bytes(data[at + 2 : at + 4], "big")
        if data[at + 1] == 0xE2 and data[at + 4 :].startswith(JPEG_NAME, 0):
            parts[data[at + 16]] = data[at + JPEG_HEAD : at + 2 + length]
        at += 2 + length
    return b"".join(parts[k] for k in sorted(parts)) or None


def _matrix_and_curves(profile: bytes) -> tuple[NDArray[np.float64], list[Curve]] | None:
    """Linear R, G, B → X, Y, Z under D50, and the curves before it; None for a profile of another kind."""
    tags = {}
    for k in range(min(struct.unpack_from(">I", profile, 128)[0], 200)):
        key, start, size = struct.unpack_from(">4sII", profile, 132 + 12 * k)
        tags[key] = profile[start : start + size]
    names = [(f"{c}XYZ".encode(), f"{c}TRC".encode()) for c in "rgb"]
    if profile[16:20] != b"RGB " or b"A2B0" in tags or not all(a in tags and b in tags for a, b in names):
        return None
    columns = [np.array(struct.unpack_from(">3i", tags[name], 8)) / 65536 for name, _ in names]
    return np.stack(columns, axis=1), [_curve(tags[name]) for _, name in names]


def _curve(tag: bytes) -> Curve:
    """A tone curve, `curv` or `para` (ICC.1:2022, 10.6, 10.18)."""
    if tag[:4] == b"curv":
        (count,) = struct.unpack_from(">I", tag, 8)
        if count == 0:
            return lambda v: v
        if count == 1:
            gamma = struct.unpack_from(">H", tag, 12)[0] / 256
            return lambda v: v**gamma
        table = np.frombuffer(tag, ">u2", count, 12) / 65535
        return lambda v: np.interp(v, np.linspace(0.0, 1.0, count), table)
    kind = struct.unpack_from(">H", tag, 8)[0]
    if tag[:4] != b"para" or kind > 4:
        raise ValueError("its curve is of no known kind")
    g, a, b, c, d, e, f = _parameters(kind, struct.unpack_from(f">{(1, 3, 4, 5, 7)[kind]}i", tag, 12))
    return lambda v: np.where(v >= d, np.maximum(a * v + b, 0.0) ** g + e, c * v + f)


def _parameters(kind: int, numbers: tuple[int, ...]) -> tuple[float, ...]:
    """g, a, b, c, d, e, f of the most general curve (ICC.1:2022, table 68)."""
    n = [x / 65536 for x in numbers]
    if kind == 0:
        return n[0], 1.0, 0.0, 0.0, 0.0, 0.0, 0.0
    if kind < 3:
        constant = n[3] if kind == 2 else 0.0
        return n[0], n[1], n[2], 0.0, -n[2] / n[1], constant, constant
    return (*n, 0.0, 0.0) if kind == 3 else tuple(n)


def xyz_from_display(name: str) -> NDArray[np.float64]:
    """(3, 3): linear R, G, B of the display → X, Y, Z under D65, white being Y = 1."""
    columns = np.array([[x / y, 1.0, (1.0 - x - y) / y] for x, y in PRIMARIES[name]]).T
    white = np.array([D65[0] / D65[1], 1.0, (1.0 - sum(D65)) / D65[1]])
    return columns * np.linalg.solve(columns, white)


def icc_profile(name: str) -> bytes:
    """The profile of sRGB or Display P3, the curve of both being sRGB's."""
    matrix = xyz_from_display(name)
    adapted = np.linalg.solve(BRADFORD, np.diag(BRADFORD @ D50 / (BRADFORD @ matrix.sum(1))) @ BRADFORD)
    primaries = adapted @ matrix
    curve = b"para\0\0\0\0" + struct.pack(">HH", 3, 0) + _fixed(*CURVE)
    tags = {
        b"desc": _text(name), b"cprt": _text("CC0"), b"wtpt": b"XYZ \0\0\0\0" + _fixed(*D50),
        b"chad": b"sf32\0\0\0\0" + _fixed(*adapted.ravel()),
        **{key: b"XYZ \0\0\0\0" + _fixed(*primaries[:, k]) for k, key in enumerate((b"rXYZ", b"gXYZ", b"bXYZ"))},
        **dict.fromkeys((b"rTRC", b"gTRC", b"bTRC"), curve),
    }  # fmt: skip
    table, data, at = b"", b"", 128 + 4 + 12 * len(tags)
    for key, content in tags.items():
        table += key + struct.pack(">II", at + len(data), len(content))
        data += content + bytes(-len(content) % 4)
    head = struct.pack(">I4sI4s4s4s", at + len(data), bytes(4), 0x04400000, b"mntr", b"RGB ", b"XYZ ")
    head += struct.pack(">6H4s4s", 2022, 1, 1, 0, 0, 0, b"acsp", bytes(4)) + bytes(24) + _fixed(*D50)
    return head.ljust(128, b"\0") + struct.pack(">I", len(tags)) + table + data


def _fixed(*numbers: float) -> bytes:
    """Numbers of sixteen bits before and behind the point."""
    return struct.pack(f">{len(numbers)}i", *(round(65536 * n) for n in numbers))


def _text(text: str) -> bytes:
    data = text.encode("utf-16-be")
    return b"mluc\0\0\0\0" + struct.pack(">II2s2sII", 1, 12, b"en", b"US", len(data), 28) + data
