"""Good samples of curves: hair in binary, lines of OBJ and glTF, Alembic."""

from __future__ import annotations

import json
import struct
import zipfile
from pathlib import Path

import numpy as np

from fuzz.meshes import glb_of, gltf_record

OBJ = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 0 1\nl 1 2\nl 2 3\nl -4 -1\n"


def hair(path: Path) -> None:
    """Two hairs of two and three points with all arrays."""
    points = np.arange(15, dtype="<f4")
    arrays = [np.array([1, 2], "<u2"), points, np.full(5, 0.1, "<f4"), np.zeros(5, "<f4"), np.ones(15, "<f4")]
    head = b"HAIR" + struct.pack("<4I5f", 2, 5, 0b11111, 0, 0.1, 0.0, 1.0, 1.0, 1.0)
    path.write_bytes(head.ljust(128, b"\0") + b"".join(array.tobytes() for array in arrays))


def glb(path: Path) -> None:
    """Lines of glTF in binary, with numbers of their points and without."""
    record = gltf_record(None)
    for mode, part in zip((1, 3), record["meshes"][0]["primitives"], strict=True):
        part["mode"] = mode
    path.write_bytes(glb_of(json.dumps(record).encode()))


def abc(path: Path) -> None:
    """Alembic, as Blender wrote it: hair and a polyline."""
    with zipfile.ZipFile(Path(__file__).parent.parent / "tests" / "files" / "blender_samples.zip") as held:
        path.write_bytes(held.read("h.abc"))
