"""Meshes go from one format to another: VTP as its text says, and what is written as trimesh and Mitsuba find it."""

import numpy as np
import pytest

from fuzz.meshes import CORNERS, TRIANGLES, ply, vtp
from hagoromo.app.cli import main
from hagoromo.app.formats.surfaces_out import WRITTEN
from hagoromo.errors import InputError
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


@pytest.mark.parametrize("suffix", WRITTEN)
def test_a_mesh_that_is_written_as_another_has_the_same_triangles(tmp_path, suffix):
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
