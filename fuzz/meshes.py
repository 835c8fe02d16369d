"""Good samples of meshes in binary: STL, PLY and glTF, whole in one file or with its arrays beside it."""

from __future__ import annotations

import base64
import json
import struct
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float32)
TRIANGLES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], np.uint16)
ARRAYS = TRIANGLES.tobytes() + CORNERS.tobytes()
TURN = [0.0, 1.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.1, 0.2, 0.3, 1.0]
FLOAT, SHORT = 5126, 5123  # types of a component in glTF
TEXT_CHUNK, BINARY_CHUNK = 0x4E4F534A, 0x004E4942


def stl(path: Path) -> None:
    """Binary: a head of 80 bytes, the count, 50 bytes a triangle."""
    records = [struct.pack("<12fH", 0, 0, 1, *CORNERS[corners].ravel(), 0) for corners in TRIANGLES]
    path.write_bytes(b"a solid".ljust(80, b"\0") + struct.pack("<I", len(records)) + b"".join(records))


def stl_text(path: Path) -> None:
    """Text."""
    text = "solid a\n"
    for corners in TRIANGLES:
        loop = "".join(f"vertex {x} {y} {z}\n" for x, y, z in CORNERS[corners])
        text += f"facet normal 0 0 1\nouter loop\n{loop}endloop\nendfacet\n"
    path.write_text(f"{text}endsolid a\n")


def vtp(path: Path) -> None:
    """VTK's polygons, as text."""
    points, corners = " ".join(map(str, CORNERS.ravel())), " ".join(map(str, TRIANGLES.ravel()))
    ends = " ".join(str(3 * k + 3) for k in range(len(TRIANGLES)))
    path.write_text(
        '<?xml version="1.0"?><VTKFile type="PolyData" version="1.0" byte_order="LittleEndian"><PolyData>'
        f'<Piece NumberOfPoints="{len(CORNERS)}" NumberOfPolys="{len(TRIANGLES)}"><Points>'
        f'<DataArray type="Float32" NumberOfComponents="3" format="ascii">{points}</DataArray></Points><Polys>'
        f'<DataArray type="Int64" Name="connectivity" format="ascii">{corners}</DataArray>'
        f'<DataArray type="Int64" Name="offsets" format="ascii">{ends}</DataArray></Polys></Piece></PolyData></VTKFile>'
    )


def ply(path: Path) -> None:
    """Little-endian, with colours that are not read."""
    head = (
        "ply\nformat binary_little_endian 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    )
    head += "property uchar red\nelement face 4\nproperty list uchar int vertex_indices\nend_header\n"
    corners = b"".join(struct.pack("<3fB", *corner, 7) for corner in CORNERS)
    path.write_bytes(head.encode() + corners + b"".join(struct.pack("<B3i", 3, *k) for k in TRIANGLES.tolist()))


def gltf_record(uri: str | None) -> dict[str, Any]:
    """A mesh of two primitives at two places, one below the other; uri: where its arrays are."""
    primitive = {"attributes": {"POSITION": 1}, "indices": 0, "mode": 4}
    views = [
        {"buffer": 0, "byteOffset": 0, "byteLength": TRIANGLES.nbytes},
        {"buffer": 0, "byteOffset": TRIANGLES.nbytes, "byteLength": CORNERS.nbytes, "byteStride": 12},
    ]
    accessors = [
        {"bufferView": 0, "componentType": SHORT, "count": TRIANGLES.size, "type": "SCALAR"},
        {"bufferView": 1, "componentType": FLOAT, "count": 4, "type": "VEC3", "max": [1, 1, 1], "min": [0, 0, 0]},
        {"bufferView": 1, "byteOffset": 12, "componentType": FLOAT, "count": 3, "type": "VEC3"},
    ]
    nodes = [{"mesh": 0, "children": [1], "name": "a", "matrix": TURN}, {"mesh": 0, "translation": [0.0, 2.0, 0.0]}]
    return {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": nodes,
        "meshes": [{"name": "m", "primitives": [primitive, {"attributes": {"POSITION": 2}}]}],
        "accessors": accessors, "bufferViews": views,
        "buffers": [{"byteLength": len(ARRAYS)} | ({} if uri is None else {"uri": uri})],
    }  # fmt: skip


def gltf(folder: Path) -> None:
    """Text, with its arrays in a file beside it."""
    (folder / "a.gltf").write_text(json.dumps(gltf_record("a.bin")))
    (folder / "a.bin").write_bytes(ARRAYS)


def gltf_inside(path: Path) -> None:
    """Text, with its arrays in it."""
    path.write_text(
        json.dumps(gltf_record("data:application/octet-stream;base64," + base64.b64encode(ARRAYS).decode()))
    )


def glb(path: Path) -> None:
    """Binary."""
    path.write_bytes(glb_of(json.dumps(gltf_record(None)).encode()))


def glb_of(text: bytes) -> bytes:
    """The binary of a JSON text and the arrays, its lengths right."""
    text += b" " * (-len(text) % 4)
    arrays = ARRAYS + b"\0" * (-len(ARRAYS) % 4)
    chunks = struct.pack("<2I", len(text), TEXT_CHUNK) + text + struct.pack("<2I", len(arrays), BINARY_CHUNK) + arrays
    return b"glTF" + struct.pack("<2I", 2, 12 + len(chunks)) + chunks


def abc(path: Path) -> None:
    """Alembic, as Blender wrote it."""
    with zipfile.ZipFile(Path(__file__).parent.parent / "tests" / "files" / "blender_samples.zip") as held:
        path.write_bytes(held.read("b.abc"))
