"""A solid of a mesh with several materials: each voxel has that of the nearest face, of every kind of file."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from trimesh.visual import ColorVisuals, TextureVisuals
from trimesh.visual.material import PBRMaterial

from hagoromo.errors import InputError
from hagoromo.files.mesh import read_parts
from hagoromo.matter.build import build
from hagoromo.volume.box import VolumeBox

MATERIAL = {"alpha": 0.2, "beta": 0.1, "gamma": 0.2, "n": 1.5, "body_colour": 0.8}
OWN = {"body_colour": 0.1, "alpha": 0.7}
RED = (200, 10, 20)
RADIUS = 4.0


def ball() -> trimesh.Trimesh:
    return trimesh.creation.icosphere(subdivisions=4, radius=RADIUS)


def is_right(mesh: trimesh.Trimesh) -> np.ndarray:
    """Faces of the half x > 0.3."""
    return mesh.triangles_center[:, 0] > 0.3


def coloured(mesh: Any) -> Any:
    """The right half is RED, the other green."""
    colours = np.where(is_right(mesh)[:, None], (*RED, 255), (9, 99, 9, 255)).astype(np.uint8)
    mesh.visual = ColorVisuals(mesh, face_colors=colours)
    return mesh


def write_obj(path: Path) -> None:
    """Two materials in turns, in quads as well; a library that is not there."""
    mesh = ball()
    right = is_right(mesh)
    lines = ["mtllib none.mtl", *("v {:.7f} {:.7f} {:.7f}".format(*vertex) for vertex in mesh.vertices)]
    for part in (slice(0, 900), slice(900, None)):
        for name, chosen in (("old brass", right), ("wood", ~right)):
            faces = mesh.faces[part][chosen[part]] + 1
            lines += [f"usemtl {name}", *("f {} {} {}".format(*face) for face in faces)]
    path.write_text("\n".join(lines) + "\n")


def write_glb(path: Path) -> None:
    """Two primitives at one place, another turn of the axes: glTF is y up."""
    scene, mesh = trimesh.Scene(), ball()
    for name, chosen in (("old brass", is_right(mesh)), ("wood", ~is_right(mesh))):
        part: Any = mesh.submesh([np.flatnonzero(chosen)], append=True)
        part.visual = TextureVisuals(material=PBRMaterial(name=name))
        scene.add_geometry(part)
    scene.export(path)


def write_ply(path: Path) -> None:
    coloured(ball()).export(path)


WRITERS = {"a.obj": (write_obj, "old brass"), "a.glb": (write_glb, "old brass"), "a.ply": (write_ply, "#c80a14")}


def built(path: Path, name: str, **recipe) -> VolumeBox:
    shape = {"form": "mesh", "file": str(path), "height_mm": 2.0 * RADIUS}
    record = {"kind": "solid", "shape": shape, "voxel_mm": 0.4, "mean_free_path_mm": 0.3, "material": MATERIAL}
    return build(record | {"face_materials": {name: OWN}} | recipe)


def dense_material(box: VolumeBox) -> np.ndarray:
    """Numbers of the materials of the voxels, as `Bricks.dense` has densities."""
    full, held = (
        np.zeros([8 * count + 1 for count in box.bricks.lattice], np.uint8),
        box.bricks.read(0, box.bricks.kept),
    )
    for (z, y, x), number in zip(box.bricks.corners(), held["material"], strict=True):
        full[z : z + 9, y : y + 9, x : x + 9] = number
    return full[tuple(slice(size) for size in box.bricks.shape)]


@pytest.mark.parametrize("name", WRITERS)
def test_voxels_have_the_material_of_the_nearest_face(name, tmp_path):
    """Of the half x > 0.3 of a ball, by the angle from its middle; beside the seam faces are 0.35 mm wide."""
    write, used = WRITERS[name]
    write(tmp_path / name)
    box = built(tmp_path / name, used)
    assert [material.alpha for material in box.materials] == [0.2, 0.7]
    density, material = box.bricks.dense()[0], dense_material(box)
    index = np.argwhere(density > 0)
    place = 1e3 * ((index[:, ::-1] + 0.5) * box.voxel_size + box.pose[:3, 3]) - (0.0, 0.0, RADIUS)
    radius = np.linalg.norm(place, axis=1)
    on_ball, number = place[:, 0] / radius * RADIUS, material[tuple(index.T)]
    lit = RADIUS - radius < 0.8 + 4 * 0.3  # as deep as light comes
    assert (number[lit & (on_ball > 0.7)] == 1).all() and (number[lit & (on_ball < -0.1)] == 0).all()
    assert lit.sum() > 5000 and (number == 1).any()


def test_matter_is_the_same_with_and_without_materials(tmp_path):
    """Density and axes, to the bit; a recipe that names no material has one only."""
    write_ply(tmp_path / "a.ply")
    plain, coloured = built(tmp_path / "a.ply", "", face_materials={}), built(tmp_path / "a.ply", "#c80a14")
    assert len(plain.materials) == 1
    for one, other in zip(plain.bricks.dense(), coloured.bricks.dense(), strict=True):
        assert np.array_equal(one, other)


def test_faces_that_close_a_hole_have_the_material_around_it(tmp_path):
    """A cap of the half x > 0.3 is lost; the fan in its place is of that half."""
    mesh = ball()
    mesh.update_faces(mesh.triangles_center[:, 0] < 3.5)
    coloured(mesh).export(tmp_path / "a.ply")
    with pytest.warns(UserWarning) as warned:  # where the fan meets the ball it is thin
        box = built(tmp_path / "a.ply", "#c80a14")
    assert "holes filled" in str(warned[0].message)
    density = box.bricks.dense()[0]
    last = int(np.flatnonzero((density > 0).any(axis=(0, 1))).max())
    near = slice(last - 3, last + 1)  # 1.6 mm of voxels behind the fan
    outermost = dense_material(box)[..., near][density[..., near] > 0]
    assert outermost.size > 50 and (outermost == 1).all()


def test_an_unknown_material_is_refused_and_the_known_ones_are_listed(tmp_path):
    write_obj(tmp_path / "a.obj")
    with pytest.raises(
        InputError, match=r"no faces of material 'gold': its materials are '(old brass', 'wood|wood', 'o)"
    ):
        built(tmp_path / "a.obj", "gold")
    with pytest.raises(InputError, match="face_materials are for a mesh"):
        built(tmp_path / "a.obj", "wood", shape={"form": "sphere", "radius_mm": 2.0})


def test_the_uv_map_of_every_kind_of_file_is_read(tmp_path):
    """A plane of 7 × 5 points whose u and v are its x and y."""
    x, y = np.meshgrid(np.linspace(0, 1, 7), np.linspace(0, 1, 5))
    points = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
    corner = np.arange(35).reshape(5, 7)
    quads = np.stack([corner[:-1, :-1], corner[:-1, 1:], corner[1:, 1:], corner[1:, :-1]], axis=-1).reshape(-1, 4)
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    mesh = trimesh.Trimesh(points, faces, process=False, visual=TextureVisuals(uv=points[:, :2]))
    for name in ("a.obj", "a.ply", "a.glb"):
        mesh.export(str(tmp_path / name))
        parts = read_parts(tmp_path / name)
        assert parts.uv is not None and len(parts.faces) == 48
        assert np.abs(parts.uv - parts.vertices[:, :2]).max() < 1e-6
    assert read_parts_of_stl(mesh, tmp_path).uv is None


def read_parts_of_stl(mesh: trimesh.Trimesh, folder: Path):
    mesh.export(str(folder / "a.stl"))
    return read_parts(folder / "a.stl")
