"""Meshes: listed formats only, of a size that is known before it is taken; nothing outside their folder is opened."""

import io
import json
import struct
import tarfile
import zipfile
from pathlib import Path

import numpy as np
import pytest

from hagoromo.errors import InputError
from hagoromo.files import memory
from hagoromo.files.gltf import MOST_NODES
from hagoromo.files.mesh import read_mesh

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32).tobytes()
OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
PLY = (
    "ply\nformat {0} 1.0\nelement vertex {1}\nproperty float x\nproperty float y\nproperty float z\n"
    "element face {1}\nproperty list uchar int vertex_indices\nend_header\n"
)


def gltf(**changes) -> dict:
    """A triangle."""
    return {
        "asset": {"version": "2.0"}, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}], "buffers": [{"byteLength": 36}], **changes,
    }  # fmt: skip


def glb(folder: Path, **changes) -> Path:
    text = json.dumps(gltf(**changes)).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(CORNERS), 0x004E4942) + CORNERS
    (folder / "a.glb").write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
    return folder / "a.glb"


def test_archives_are_not_opened(tmp_path):
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        archive.writestr("a.obj", OBJ)
    with tarfile.open(tmp_path / "a.tar.gz", "w:gz") as archive:
        entry = tarfile.TarInfo("a.obj")
        entry.size = len(OBJ)
        archive.addfile(entry, io.BytesIO(OBJ.encode()))
    for name in ("a.zip", "a.tar.gz"):
        with pytest.raises(InputError, match="no mesh file of a known format"):
            read_mesh(tmp_path / name)
        (tmp_path / name).rename(tmp_path / "a.ply")  # by any name
        with pytest.raises(InputError, match="cannot be read as a mesh"):
            read_mesh(tmp_path / "a.ply")


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("a.ply", PLY.format("binary_little_endian", 2_000_000_000).encode() + bytes(100)),
        ("a.ply", PLY.format("ascii", 2_000_000_000).encode() + b"0 0 0\n"),
        ("a.stl", bytes(80) + struct.pack("<I", 2**32 - 1) + bytes(100)),
        ("a.off", b"OFF\n2000000000 2000000000 0\n0 0 0\n"),
    ],
)
def test_a_header_that_promises_more_than_the_file_has_is_refused(tmp_path, name, data):
    (tmp_path / name).write_bytes(data)
    with pytest.raises(InputError, match=f"{name} (cannot be read|holds no triangles)"):
        read_mesh(tmp_path / name)


def test_the_memory_of_a_mesh_is_asked_for_before_it_is_read(tmp_path, monkeypatch):
    (tmp_path / "a.obj").write_text(OBJ * 100)
    assert len(read_mesh(tmp_path / "a.obj").faces) == 100
    monkeypatch.setattr(memory, "free_memory", lambda: 30 * len(OBJ * 100))
    with pytest.raises(InputError, match="GiB of memory"):
        read_mesh(tmp_path / "a.obj")


def test_a_gltf_is_as_large_as_its_arrays_and_places(tmp_path):
    assert len(read_mesh(glb(tmp_path)).faces) == 1
    vast = [{"componentType": 5126, "count": 10**10, "type": "VEC3"}]
    with pytest.raises(InputError, match="accessor 0 is sparse, or packed by an extension"):
        read_mesh(glb(tmp_path, accessors=vast))
    with pytest.raises(InputError, match="accessor 0 states 10000000000 VEC3 and does not hold them"):
        read_mesh(glb(tmp_path, accessors=[vast[0] | {"bufferView": 0}]))
    with pytest.raises(InputError, match="nodes"):
        read_mesh(glb(tmp_path, nodes=[{"mesh": 0}] * (MOST_NODES + 1)))
    part = {"attributes": {"POSITION": 0}}
    with pytest.raises(InputError, match="GiB of memory"):  # each part at each place
        read_mesh(glb(tmp_path, nodes=[{"mesh": 0}] * 60_000, meshes=[{"primitives": [part] * 3000}]))
    for count in (-1, "many", 1e300, None, True):
        with pytest.raises(InputError):
            read_mesh(glb(tmp_path, accessors=[vast[0] | {"count": count}]))


def test_a_gltf_reads_files_of_its_own_folder_only(tmp_path):
    home = tmp_path / "home"
    home.mkdir()
    for folder in (tmp_path, home):
        (folder / "a.bin").write_bytes(CORNERS)
    (home / "link.bin").symlink_to(tmp_path / "a.bin")
    for uri, said in (
        ("a.bin", ""),
        ("../a.bin", "outside"),
        ("link.bin", "outside"),
        ("http://localhost/a.bin", "does not exist"),
    ):
        (home / "a.gltf").write_text(json.dumps(gltf(buffers=[{"byteLength": 36, "uri": uri}])))
        if uri == "a.bin":
            assert len(read_mesh(home / "a.gltf").faces) == 1
            continue
        with pytest.raises(InputError, match=said):
            read_mesh(home / "a.gltf")


def test_textures_are_not_read(tmp_path):
    (tmp_path / "a.mtl").write_text("newmtl a\nmap_Kd t.png\n")
    (tmp_path / "a.obj").write_text("mtllib a.mtl\nusemtl a\nvt 0 0\n" + OBJ.replace("1 2 3", "1/1 2/1 3/1"))
    assert len(read_mesh(tmp_path / "a.obj").faces) == 1


def test_corners_of_two_coordinates_are_refused(tmp_path):
    """trimesh reads them by the first of them."""
    (tmp_path / "a.obj").write_bytes(b"v 0 0\nv 1 0 0\nv 0 -1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\nf 1 3 4\n")
    with pytest.raises(InputError, match="2 coordinates"):
        read_mesh(tmp_path / "a.obj")
