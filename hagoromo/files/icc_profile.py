"""ICC profile: what says in a PNG or TIFF which colours its numbers are, for displays of three primaries under D65.

A matrix and a curve (ICC.1:2022, 8.3.3), made here, as LittleCMS in Pillow makes that of sRGB only.
"""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import NDArray

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
