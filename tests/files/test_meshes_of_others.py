"""Meshes go from one format to another: VTP as its text says, and what is written as trimesh and Mitsuba find it."""

import zipfile
from pathlib import Path

import numpy as np
import pytest

from fuzz.meshes import CORNERS, TRIANGLES, ply, vtp
from hagoromo.app.cli import main
from hagoromo.errors import InputError
from hagoromo.files.format import formats_of
from hagoromo.files.mesh import read_mesh


def triangles(mesh) -> np.ndarray:
    """The corners of each triangle in an order of their own: (n, 9)."""
    corners = np.asarray(mesh.vertices)[np.asarray(mesh.faces)]
    turned = [np.roll(one, -int(np.lexsort(one.T)[0]), axis=0).ravel() for one in corners]
    return np.array(sorted(map(tuple, np.round(turned, 6))))


def test_vtk_polygons_are_read_as_their_text_says(tmp_path):
    pytest.importorskip("vtkmodules", reason="VTP is read by VTK, which is not installed")
    vtp(tmp_path / "a.vtp")
    ply(tmp_path / "a.ply")
    assert np.array_equal(triangles(read_mesh(tmp_path / "a.vtp")), triangles(read_mesh(tmp_path / "a.ply")))
    text = (tmp_path / "a.vtp").read_text()
    for name, data in {"cut": text[: len(text) // 2], "far": text.replace(" 1 2 3<", " 1 2 99<"), "none": ""}.items():
        (tmp_path / f"{name}.vtp").write_text(data)
        with pytest.raises(InputError, match=f"{name}.vtp"):
            read_mesh(tmp_path / f"{name}.vtp")


def test_alembic_is_read_as_blender_wrote_it(tmp_path):
    """Blender 5.0 wrote the same two objects, moved, turned and scaled, as STL: in blender_samples.zip."""
    pytest.importorskip("alembic3d", reason="Alembic is read by alembic3d, which is not installed")
    with zipfile.ZipFile(Path(__file__).with_name("blender_samples.zip")) as held:
        for name in held.namelist():
            (tmp_path / name).write_bytes(held.read(name))
    found, expected = read_mesh(tmp_path / "b.abc"), read_mesh(tmp_path / "b.stl")
    assert found.bounds == pytest.approx(expected.bounds, abs=1e-6)
    assert found.volume == pytest.approx(expected.volume, rel=1e-6) and found.volume > 0
    assert found.area == pytest.approx(expected.area, rel=1e-6) and len(found.faces) == len(expected.faces)
    data = (tmp_path / "b.abc").read_bytes()
    for name, spoilt in {"cut": data[: len(data) // 2], "none": b"", "text": b"Ogawa"}.items():
        (tmp_path / f"{name}.abc").write_bytes(spoilt)
        with pytest.raises(InputError, match=f"{name}.abc"):
            read_mesh(tmp_path / f"{name}.abc")


WRITTEN = [suffix for form in formats_of("surface", "scene") if form.mesh_writer for suffix in form.suffixes]


@pytest.mark.parametrize("suffix", [suffix for suffix in WRITTEN if suffix != ".gltf"])
def test_a_mesh_that_is_written_as_another_has_the_same_triangles(tmp_path, suffix):
    if suffix.startswith(".usd"):
        pytest.importorskip("pxr", reason="USD is written by usd-core, which is not installed")
    ply(tmp_path / "a.ply")
    assert main(["convert", str(tmp_path / "a.ply"), "--out", str(tmp_path / f"b{suffix}")]) == 0
    assert len(TRIANGLES) == len(triangles(read_mesh(tmp_path / f"b{suffix}"))) and len(CORNERS) == 4
    assert np.allclose(triangles(read_mesh(tmp_path / f"b{suffix}")), triangles(read_mesh(tmp_path / "a.ply")))


@pytest.mark.parametrize("suffix", [".ply", ".obj"])
def test_mitsuba_finds_the_same_triangles(tmp_path, suffix):
    import mitsuba as mi

    mi.set_variant("scalar_rgb")
    ply(tmp_path / "a.ply")
    main(["convert", str(tmp_path / "a.ply"), "--out", str(tmp_path / f"b{suffix}")])
    mesh = mi.load_dict({"type": suffix[1:], "filename": str(tmp_path / f"b{suffix}")})
    assert mesh.face_count() == 4
    assert np.array(mesh.bbox().max) == pytest.approx([1.0, 1.0, 1.0])
    assert mesh.surface_area() == pytest.approx(1.5 + np.sqrt(3) / 2)


def test_a_mesh_is_not_written_as_what_is_none(tmp_path, capsys):
    ply(tmp_path / "a.ply")
    assert main(["convert", str(tmp_path / "a.ply"), "--out", str(tmp_path / "a.json")]) == 2
    assert "written as .ply, .obj" in capsys.readouterr().err
