"""Good samples of tables of reflectances."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

DIRECTIONS = "theta_lamp_deg,phi_lamp_deg,theta_eye_deg,phi_eye_deg"
CODES = {"uint8": 1, "float32": 10}  # of types, in a tensor file


def csv(path: Path) -> None:
    """Directions, two channels and their variances."""
    rows = [f"{lamp},0,{eye},180,0.2,0.1,1e-6,1e-6" for lamp in (0, 30, 60) for eye in (5, 35)]
    path.write_text("\n".join([f"{DIRECTIONS},R,G,variance_R,variance_G", *rows]) + "\n")


def rgl(path: Path) -> None:
    """A tensor file of RGL on a small grid: matt, in three wavelengths."""
    side = 4
    even = np.ones((1, side, side, side), np.float32)
    fields = {
        "description": np.frombuffer(b"matt", np.uint8), "phi_i": np.zeros(1, np.float32),
        "theta_i": np.linspace(0.0, 1.4, side, dtype=np.float32), "ndf": even[0, 0], "sigma": even[0, 0],
        "vndf": even, "luminance": even, "spectra": np.full((1, side, 3, side, side), 0.1, np.float32),
        "wavelengths": np.array([420.0, 560.0, 700.0], np.float32), "jacobian": np.zeros(1, np.uint8),
    }  # fmt: skip
    head, body = b"tensor_file\0\1\0" + struct.pack("<I", len(fields)), b""
    place = len(head) + sum(13 + len(name) + 8 * array.ndim for name, array in fields.items())
    for name, array in fields.items():
        head += struct.pack("<H", len(name)) + name.encode() + struct.pack("<HB", array.ndim, CODES[array.dtype.name])
        head += struct.pack(f"<Q{array.ndim}Q", place + len(body), *array.shape)
        body += array.tobytes()
    path.write_bytes(head + body)
