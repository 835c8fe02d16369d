"""A solid is what its mesh encloses: volume, outward axes, the optical depth of thin parts; repairs are said."""

import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from scipy.ndimage import label

from hagoromo.backend import arrays
from hagoromo.errors import InputError
from hagoromo.matter.build import build
from hagoromo.matter.shape import distance_and_normal
from hagoromo.volume.box import VolumeBox
from hagoromo_matter.solid.solid import MeshSurface
from tests.data import DATA, real_data

LUCY = DATA / "meshes_volumes" / "lucy.ply"
MATERIAL = {"alpha": 0.2, "beta": 0.1, "gamma": 0.2, "n": 1.5, "body_colour": 0.8}
TORUS = trimesh.creation.torus(1.0, 0.4, major_sections=61, minor_sections=37)  # about z: 0.8 high


def built(mesh: Any, path: Path, voxel_mm: float, scale: float = 1.0, thin: str = "thicken", **how) -> VolumeBox:
    """The solid of a mesh that was written to `path`, as high as it is times `scale`."""
    mesh.export(str(path), **how)
    shape = {"form": "mesh", "file": str(path), "height_mm": float(scale * mesh.extents[2])}
    return build({"kind": "solid", "shape": shape, "voxel_mm": voxel_mm, "thin": thin, "material": MATERIAL})


def volume_mm3(box: VolumeBox) -> float:
    density, _ = box.bricks.dense()
    return float(density.sum(dtype=float)) * (1e3 * box.voxel_size) ** 3


def ball(radius: float = 1.0, at: tuple[float, ...] = (0.0, 0.0, 0.0)) -> trimesh.Trimesh:
    return trimesh.creation.icosphere(subdivisions=3, radius=radius).apply_translation(at)


@pytest.mark.parametrize("voxel_mm", [2.0, 1.0, 0.4])
def test_a_ring_keeps_its_volume_at_any_resolution(voxel_mm, tmp_path):
    """A tube of radius r = 4 mm, whose edges, two voxels h wide, enlarge it by h²/3r²; facets make r 1 % smaller."""
    box = built(TORUS, tmp_path / "ring.ply", voxel_mm, 10.0)
    assert volume_mm3(box) == pytest.approx(1000 * TORUS.volume * (1 + voxel_mm**2 / 48), rel=0.006)


def test_axes_of_a_ring_look_outwards(tmp_path):
    """Against the normal of the true torus, on the surface: facets of 10° turn interpolated normals by 1° at most."""
    box = built(TORUS, tmp_path / "ring.ply", 0.7, 10.0)
    density, axis = box.bricks.dense()
    index = np.argwhere((density > 0.05) & (density < 0.95))
    place = 1e3 * ((index[:, ::-1] + 0.5) * box.voxel_size + box.pose[:3, 3]) - (0.0, 0.0, 4.0)
    ring = place * (1, 1, 0)
    outward = place - 10.0 * ring / np.linalg.norm(ring, axis=1, keepdims=True)
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    along = (axis[tuple(index.T)].astype(float) * outward).sum(axis=1)
    assert along.min() > np.cos(np.radians(3))  # and 1° of two rounded components


@pytest.mark.by_night("a.obj-how4", "a.glb-how6", "a.stl-how2")
@pytest.mark.parametrize(
    ("name", "how"),
    [("a.ply", {}), ("b.ply", {"encoding": "ascii"}), ("a.stl", {}), ("b.stl", {"file_type": "stl_ascii"}),
     ("a.obj", {}), ("a.off", {}), ("a.glb", {})],
)  # fmt: skip
def test_every_kind_of_mesh_file_gives_the_same_solid(name, how, tmp_path):
    """Two parts, one beside the other; a scene of two where the kind knows scenes. Soft edges: h²/r² more of a ball."""
    scene = trimesh.Scene([ball(), ball(0.5, (2.5, 0.0, 0.0))])
    mesh: Any = scene if name.endswith(".glb") else scene.to_mesh()
    truth = 125 * (ball().volume * (1 + 0.07**2) + ball(0.5).volume * (1 + 0.14**2))
    if name.endswith(".glb"):  # glTF is y up
        assert mesh.extents[1] == pytest.approx(mesh.extents[2])
    assert volume_mm3(built(mesh, tmp_path / name, 0.35, 5.0, **how)) == pytest.approx(truth, rel=0.005)


def test_overlapping_parts_count_once_and_cavities_stay_empty(tmp_path):
    """Two balls, 1 apart, share a lens of π(4 + h)(2 − h)²/12, h = 1; a ball has a hole of half its radius."""
    both = trimesh.util.concatenate([ball(), ball(at=(1.0, 0.0, 0.0))])
    union = 2 * ball().volume - np.pi * 5 / 12
    assert volume_mm3(built(both, tmp_path / "both.ply", 0.3, 5.0)) == pytest.approx(125 * union, rel=0.01)
    hole = ball(0.5)
    hole.invert()
    hollow: Any = trimesh.util.concatenate([ball(), hole])
    assert volume_mm3(built(hollow, tmp_path / "hollow.ply", 0.3, 5.0)) == pytest.approx(125 * hollow.volume, rel=0.01)


def holed(faces: int) -> trimesh.Trimesh:
    """A ball without the faces next to its top."""
    mesh = ball()
    mesh.update_faces(np.argsort(-mesh.triangles_center[:, 2]) >= faces)
    return mesh


def turned(mesh: trimesh.Trimesh, which: slice) -> trimesh.Trimesh:
    mesh.faces[which] = mesh.faces[which][:, ::-1]
    return mesh


def with_fin(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """An edge gets a third face: no manifold any more."""
    a, b, _ = mesh.faces[0]
    return trimesh.Trimesh([*mesh.vertices, 1.05 * mesh.vertices[a]], [*mesh.faces, (a, b, len(mesh.vertices))])


@pytest.mark.parametrize(
    ("mesh", "said", "share"),
    [
        (turned(ball(), slice(None)), "faces turned outwards", 1.0),
        (turned(ball(), slice(0, 400, 3)), "faces turned the same way", 1.0),
        (trimesh.util.concatenate([ball(), turned(ball(0.5, (2.5, 0, 0)), slice(None))]), "1 of its parts", 1.125),
        (holed(1), "holes filled by 1 faces", 1.0),
        (holed(40), "holes filled", 1.0),
        (with_fin(ball()), "most of three rays", 1.0),
    ],
)
def test_a_mesh_that_encloses_nothing_is_repaired_and_said_so(mesh, said, share, tmp_path):
    """A filled hole of 40 of 1280 faces lacks a cap of 0.2 % of the ball; a fin adds a sliver."""
    with pytest.warns(UserWarning, match=said) as warned:
        box = built(mesh, tmp_path / "broken.ply", 0.3, 5.0)
    assert len(warned) == 1
    assert "\n" not in str(warned[0].message) and "broken.ply" in str(warned[0].message)
    assert volume_mm3(box) == pytest.approx(share * 125 * ball().volume, rel=0.01)


def test_a_mesh_that_cannot_be_closed_keeps_its_volume(tmp_path):
    """Faces lost here and there; each hole a fan, or told by rays."""
    mesh = ball()
    mesh.update_faces(np.random.default_rng(3).random(len(mesh.faces)) > 0.08)
    with pytest.warns(UserWarning, match="does not enclose a volume as it is"):
        box = built(mesh, tmp_path / "torn.ply", 0.3, 5.0)
    assert volume_mm3(box) == pytest.approx(125 * ball().volume, rel=0.02)


@pytest.mark.parametrize("thin", ["thicken", "warn"])
@pytest.mark.parametrize("thickness_mm", [0.05, 0.6, 1.0])
def test_thin_parts_are_two_voxels_thick_or_keep_their_optical_depth(thickness_mm, thin, tmp_path):
    """A plate aslant to a lattice of 0.6 mm, its rim left out: mass per area is the thickness; two sides, two normals.

    2 %: whole voxels in 8 mm. Beside the rim, whose nearest surface looks along the plate, there may be more.
    """
    plate = trimesh.creation.box((11.0, thickness_mm, 13.0))
    plate.apply_transform(trimesh.transformations.rotation_matrix(0.35, (0, 0, 1)))
    with pytest.warns(UserWarning, match="of its surface is thinner than two voxels of 0.6 mm") as warned:
        box = built(plate, tmp_path / "plate.stl", 0.6, thin=thin)
    said = str(warned[0].message)
    share = 11 * 13 / (11 * 13 + (11 + 13) * thickness_mm)  # of the two sides; the rim has 11 mm and more beneath it
    assert float(said.split()[1]) == pytest.approx(100 * share, abs=0.8)  # 4 standard errors of 32768 places
    assert f"voxels of {0.5 * thickness_mm:.2g} mm" in said
    density, axis = box.bricks.dense()
    index = np.argwhere(density > 0)
    place = 1e3 * ((index[:, ::-1] + 0.5) * box.voxel_size + box.pose[:3, 3])
    along = np.abs(place[:, :2] @ (np.cos(0.35), np.sin(0.35)))
    middle = (along < 4.0) & (np.abs(place[:, 2] - 6.5) < 5.1)  # 8 mm × 17 layers of voxels
    mass = density[tuple(index[middle].T)].sum(dtype=float) * 0.6**3
    assert mass == pytest.approx(8.0 * 17 * 0.6 * (1.2 if thin == "thicken" else thickness_mm), rel=0.02)
    sides = axis[tuple(index[middle].T)].astype(float) @ (-np.sin(0.35), np.cos(0.35), 0.0)
    assert (sides > 0.99).mean() > 0.45 and (sides < -0.99).mean() > 0.45


@pytest.mark.parametrize("thin", ["thicken", "warn"])
def test_a_needle_is_not_lost(thin, tmp_path):
    """A quarter of a voxel thick: every slice across it holds at least its own volume, or that of two voxels."""
    needle = trimesh.creation.cylinder(0.075, 13.0)
    with pytest.warns(UserWarning, match="thinner than two voxels"):
        box = built(needle, tmp_path / "needle.ply", 0.6, thin=thin)
    slices = box.bricks.dense()[0].sum(axis=(1, 2), dtype=float) * 0.6**2
    assert slices[3:-3].min() > np.pi * (0.6 if thin == "thicken" else 0.075) ** 2


def test_the_tip_of_a_cone_stays_opaque(tmp_path):
    """Up to the tip there is two voxels of matter around the axis; where it is thicker than that all is as before.

    Its density falls over two voxels from 1 on the axis: a line of voxels at a quarter of that beside it sees 0.84 of
    two voxels, a lattice of these voxels 0.75 at least.
    """
    cone = trimesh.creation.cone(3.0, 12.0, sections=64)
    depth = {}
    for thin in ("thicken", "warn"):
        with pytest.warns(UserWarning, match="thinner than two voxels"):
            density = built(cone, tmp_path / "cone.ply", 0.5, thin=thin).bricks.dense()[0]
        depth[thin] = density.sum(axis=2, dtype=float).max(axis=1)[2:26] * 0.5  # slices up to the tip
    assert depth["thicken"].min() > 0.75
    assert depth["warn"].min() < 0.5
    wide = depth["warn"][1:] > 1.5
    assert wide.sum() > 12 and np.array_equal(depth["thicken"][1:][wide], depth["warn"][1:][wide])


def test_a_closed_shallow_bowl_is_opaque_up_to_its_rim(tmp_path):
    """The cap of a ball, open below, 1 mm high: a fan closes it. Seen from above nothing is thinner than two voxels."""
    cap = ball(5.0)
    cap.update_faces(cap.triangles_center[:, 2] > 4.2)
    seen_mm2 = (cap.area_faces * cap.face_normals[:, 2]).sum()
    opaque_mm2 = {}
    for thin in ("thicken", "warn"):
        with pytest.warns(UserWarning) as warned:
            density = built(cap, tmp_path / "cap.ply", 0.4, thin=thin).bricks.dense()[0]
        assert ["holes filled" in str(w.message) for w in warned] == [True, False]
        opaque_mm2[thin] = (density.sum(axis=0, dtype=float) * 0.4 > 0.75).sum() * 0.4**2  # 0.8: lines of voxels vary
    assert opaque_mm2["warn"] < 0.6 * seen_mm2 < 0.95 * seen_mm2 < opaque_mm2["thicken"]


def test_meshes_that_enclose_nothing_are_refused(tmp_path):
    sheet_of_two = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 1, 1], [1, 1, 1]], [[0, 1, 2], [1, 3, 2]])
    sheet_of_two.export(tmp_path / "open.ply")
    (tmp_path / "text.ply").write_text("no mesh")
    for name, message in (("open.ply", "does not enclose"), ("text.ply", "cannot be read"), ("none.ply", "not exist")):
        shape = {"form": "mesh", "file": str(tmp_path / name), "height_mm": 5.0}
        with pytest.raises(InputError, match=message):
            build({"kind": "solid", "shape": shape, "material": MATERIAL})


@pytest.mark.slow
@real_data("meshes_volumes/lucy.ply")
@pytest.mark.parametrize("voxel_mm", [0.8, 0.25])
def test_an_angel_of_a_hundred_thousand_faces_keeps_her_volume(voxel_mm, tmp_path):
    """100 mm high, wings and folds about 1 mm thick; all of one piece, without specks; it does not hang."""
    mesh: Any = trimesh.load_mesh(LUCY)
    start = time.process_time()
    shape = {"form": "mesh", "file": str(LUCY), "height_mm": 100.0, "rotation_deg": [0.0, 0.0, 180.0]}
    with pytest.warns(UserWarning, match="thinner than two voxels"):
        box = build({"kind": "solid", "shape": shape, "voxel_mm": voxel_mm, "thin": "warn", "material": MATERIAL})
    assert time.process_time() - start < 600  # s of a core: some tens, but for a fault of the tree
    pieces = np.zeros(box.bricks.shape, np.int32)
    assert label(box.bricks.dense()[0] > 0, np.ones((3, 3, 3)), output=pieces) == 1
    assert volume_mm3(box) == pytest.approx(mesh.volume * (100.0 / mesh.extents[2]) ** 3, rel=0.02)


@pytest.mark.parametrize("name", ["a.ply", "a.stl", "a.obj", "a.off", "a.glb"])
def test_a_shallow_slope_has_no_terraces(name, tmp_path):
    """A wedge whose top rises by 2°, on voxels of 0.5 mm: columns of voxels hold its height, to 1 % of a voxel.

    Terraces would be off by half a voxel. Half floats leave 0.05 % of a column of 5 mm; files of single precision less.
    """
    wedge = trimesh.creation.box((40.0, 6.0, 4.0)).apply_translation((0.0, 0.0, 2.0))
    rise = np.tan(np.radians(2.0)) * (wedge.vertices[:, 0] + 20.0)
    wedge.vertices[:, 2] += np.where(wedge.vertices[:, 2] > 1.0, rise, 0.0)
    height = float(wedge.vertices[:, 2].max())
    if name.endswith(".glb"):
        wedge.apply_transform(np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]]))
    wedge.export(str(tmp_path / name))
    shape = {"form": "mesh", "file": str(tmp_path / name), "height_mm": height}
    shape |= {"rotation_deg": [90.0, 0.0, 0.0]} if name.endswith(".glb") else {}
    box = build({"kind": "solid", "shape": shape, "voxel_mm": 0.5, "material": MATERIAL})
    held = box.bricks.dense()[0].sum(axis=0, dtype=float) * 0.5
    y, x = (
        1e3 * (box.pose[k, 3] + (np.arange(n) + 0.5) * box.voxel_size) for k, n in zip((1, 0), held.shape, strict=True)
    )
    whole = np.ix_(np.abs(y) < 2.0, np.abs(x) < 18.0)  # columns away from the sides
    off = held[whole] - (4.0 + (x[whole[1]] + 20.0) * np.tan(np.radians(2.0)))
    assert off.shape[0] > 6 and off.shape[1] > 60
    assert np.abs(off).max() < 0.005


def test_the_signed_distance_to_a_mesh_is_that_of_its_body(tmp_path):
    """A ball of fine faces: distances within its sagitta (of edges of 5.6°, 0.12 %), smooth normals near the surface.

    Far away the nearest point of a face may lie half an edge aside, near it that times the distance.
    """
    trimesh.creation.icosphere(subdivisions=4, radius=1.0).export(tmp_path / "a.ply")
    mesh = MeshSurface(tmp_path / "a.ply", 20.0)
    way = np.random.default_rng(5).normal(size=(211, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    radius = np.linspace(4.0, 30.0, 211)
    point = arrays().Array3f(*(radius[:, None] * way + (0.0, 0.0, 10.0)).T.astype(np.float32))
    away, normal = distance_and_normal(mesh.signed_distance, point)
    assert np.abs(np.array(away) - (radius - 10.0)).max() < 0.0013 * 10.0
    along = (np.array(normal).T * way).sum(axis=1)
    assert along.min() > np.cos(np.radians(2.8))
    assert along[np.abs(radius - 10.0) < 1.0].min() > np.cos(np.radians(0.5))


def test_skin_covers_a_mesh_as_it_covers_the_shape(tmp_path):
    """A ball as a mesh and as a form: the same matter, but for what faces are inside of the ball."""
    trimesh.creation.icosphere(subdivisions=4, radius=1.0).export(tmp_path / "a.ply")
    recipe = {"kind": "skin", "voxel_mm": 0.4, "mean_free_path_mm": 0.4, "corneum_mm": 0.0, "material": MATERIAL}
    mesh = {"form": "mesh", "file": str(tmp_path / "a.ply"), "height_mm": 8.0}
    volumes = [volume_mm3(build(recipe | {"shape": s})) for s in (mesh, {"form": "sphere", "radius_mm": 4.0})]
    assert volumes[0] == pytest.approx(volumes[1], rel=0.01)


def test_skin_on_a_thin_mesh_is_warned_about(tmp_path):
    """A plate of half a voxel; skin is not thickened."""
    trimesh.creation.box((4.0, 0.2, 4.0)).export(tmp_path / "a.ply")
    shape = {"form": "mesh", "file": str(tmp_path / "a.ply"), "height_mm": 4.0}
    with pytest.warns(UserWarning, match="thinner than two voxels of 0.4 mm and lets light through"):
        build({"kind": "skin", "voxel_mm": 0.4, "mean_free_path_mm": 0.4, "shape": shape, "material": MATERIAL})
