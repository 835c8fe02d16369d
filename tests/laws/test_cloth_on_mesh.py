"""Cloth lies on a mesh by its UV map: on a cylinder as if it were wrapped; stretch, seams, hems are told."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from trimesh.visual import TextureVisuals

from hagoromo.backend import arrays
from hagoromo.errors import InputError
from hagoromo.matter.build import build
from hagoromo_matter.drape import drape
from hagoromo_matter.drape.mesh_chart import mesh_chart
from hagoromo_matter.drape.uv_mesh import UvMesh, uv_mesh

RADIUS, HEIGHT, SEGMENTS = 8.0, 13.0, 90
AROUND = 2.0 * np.pi * RADIUS
FIBRE = {"alpha": 0.25, "beta": 0.1, "gamma": 0.3, "n": 1.5, "body_colour": 0.7}


def sheet(u: np.ndarray, v: np.ndarray, place: Any) -> trimesh.Trimesh:
    """A grid with the UV map u, v; place: its points."""
    s, t = np.meshgrid(u, v)
    corner = np.arange(s.size).reshape(s.shape)
    a, b, c, d = (part.ravel() for part in (corner[:-1, :-1], corner[:-1, 1:], corner[1:, 1:], corner[1:, :-1]))
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    points = np.stack(np.broadcast_arrays(*place(s, t)), axis=-1).reshape(-1, 3)
    uv = np.stack([s.ravel(), t.ravel()], axis=1)
    return trimesh.Trimesh(points, faces, process=False, visual=TextureVisuals(uv=uv))


def tube(path: Path) -> Path:
    """An open cylinder about z; u goes once around, v up. Written as OBJ."""
    mesh = sheet(
        np.linspace(0, 1, SEGMENTS + 1),
        np.linspace(0, 1, 6),
        lambda s, t: (RADIUS * np.cos(2 * np.pi * s), RADIUS * np.sin(2 * np.pi * s), HEIGHT * t),
    )
    mesh.vertices[SEGMENTS :: SEGMENTS + 1] = mesh.vertices[:: SEGMENTS + 1]  # the seam is one place
    mesh.export(path)
    return path


def laid(path: Path, uv_mm: tuple[float, float] | None = None, period: tuple[float, float] = (1.0, 1.0)) -> UvMesh:
    return uv_mesh(path, HEIGHT, (0.0, 0.0, 0.0), uv_mm, period)


def at(cloth: UvMesh, points: np.ndarray, edge: float = 1.0):
    chart = mesh_chart(cloth, 2.0, edge)[0](arrays().Array3f(*np.ascontiguousarray(points.T, np.float32)))
    return {name: np.array(value) for name, value in chart._asdict().items()}


def test_cloth_on_a_cylinder_is_the_flat_cloth_wrapped(tmp_path):
    """u is the arc, v the height, heights are radial. Of 90 sides: they sag R(1 − cos 2°) = 5 µm.

    Off a facet u follows its normal, not the radius: 1 mm times 2° at most, 0.3° on the cylinder; normals are smooth.
    """
    cloth = laid(tube(tmp_path / "a.obj"), (AROUND, HEIGHT))
    draw = np.random.default_rng(7)
    angle, radius, z = draw.uniform(0.02, 2 * np.pi - 0.02, 3001), draw.uniform(-1, 1, 3001), draw.uniform(1, 12, 3001)
    way = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    chart = at(cloth, (RADIUS + radius)[:, None] * way + z[:, None] * (0, 0, 1))
    assert np.abs(chart["height"] - radius).max() < 0.006
    assert np.abs(chart["u"] - RADIUS * angle).max() < 0.04
    assert np.abs(chart["u"] - RADIUS * angle).mean() < 0.015
    assert np.abs(chart["v"] - z).max() < 1e-3  # single precision
    assert (chart["normal"].T * way).sum(axis=1).min() > np.cos(np.radians(0.3))
    across = np.stack([-way[:, 1], way[:, 0], 0 * angle], axis=1)
    assert (chart["along_u"].T * across).sum(axis=1).min() > np.cos(np.radians(0.3))
    assert (chart["presence"] == 1).all()


def test_a_pattern_that_goes_on_around_a_cylinder_has_no_seam(tmp_path):
    """Of 40 periods around; of 40.3 the seam is as long as the cylinder. Without uv_mm the mean stretch is none."""
    path = tube(tmp_path / "a.obj")
    assert laid(path, (AROUND, HEIGHT), (AROUND / 40, 1.0)).seams_mm == 0.0
    seamed = laid(path, (AROUND, HEIGHT), (AROUND / 40.3, 1.0))
    assert seamed.seams_mm == pytest.approx(HEIGHT)
    with pytest.warns(UserWarning, match=r"a: cloth of 50.27 × 13 mm per unit .* by up to 0 % .* with 13 mm of seams"):
        seamed.say("a")
    assert laid(path).uv_mm == pytest.approx([np.sqrt(AROUND * HEIGHT)] * 2, rel=1e-3)


def test_stretch_is_that_of_the_map(tmp_path):
    """A plane whose u grows by 1 in 20 mm, sheared by 0.3, on 25 mm of cloth: the singular values of its map."""
    slanted = sheet(np.linspace(0, 1, 9), np.linspace(0, 1, 8), lambda s, t: (20 * s + 3.9 * t, 0 * s, HEIGHT * t))
    slanted.export(tmp_path / "a.obj")
    least, most = laid(tmp_path / "a.obj", (25.0, 13.0)).stretch()
    sizes = np.linalg.svd(np.array([[20 / 25, 3.9 / 13], [0, 1]]), compute_uv=False)
    assert (most, least) == pytest.approx(tuple(sizes), rel=1e-5)


def test_a_mirrored_island_has_its_upper_side_outside_and_lies_far_from_the_others(tmp_path):
    """Two planes side by side with the same map, one of them mirrored: v goes along normal × u on both."""
    u, v = np.linspace(0, 1, 9), np.linspace(0, 1, 8)
    left: Any = sheet(u, v, lambda s, t: (10 * s - 10, 0 * s, HEIGHT * t))
    right: Any = sheet(u, v, lambda s, t: (10 - 10 * s, 0 * s, HEIGHT * t))
    right.invert()
    points, faces = np.concatenate([left.vertices, right.vertices]), np.concatenate([left.faces, right.faces + 72])
    uv = np.concatenate([left.visual.uv, right.visual.uv])
    trimesh.Trimesh(points, faces, process=False, visual=TextureVisuals(uv=uv)).export(tmp_path / "a.obj")
    cloth = laid(tmp_path / "a.obj", (10.0, HEIGHT))
    draw = np.random.default_rng(2)
    points = np.stack([draw.uniform(-9, 9, 400), draw.uniform(-1, 1, 400), draw.uniform(1, 12, 400)], axis=1)
    chart = at(cloth, points)
    assert np.abs(chart["height"] + points[:, 1]).max() < 1e-5
    assert np.abs(chart["normal"].T - (0, -1, 0)).max() < 1e-5
    assert np.abs(chart["along_u"].T - (1, 0, 0)).max() < 1e-5
    assert np.ptp(chart["u"] - points[:, 0], axis=0) > 500
    for side in (points[:, 0] < -0.1, points[:, 0] > 0.1):
        assert np.ptp((chart["u"] - points[:, 0])[side]) < 1e-3
        assert np.ptp((chart["v"] - points[:, 2])[side]) < 1e-3


def test_presence_is_a_half_on_the_hem(tmp_path):
    """Of an open plane: it falls linearly from 1 to 0 over edge_mm across the hem, u goes on, heights stay."""
    plane = sheet(np.linspace(0, 1, 9), np.linspace(0, 1, 8), lambda s, t: (20 * s, 0 * s, HEIGHT * t))
    plane.export(tmp_path / "a.obj")
    out = np.linspace(-1.2, 1.2, 121)
    chart = at(
        laid(tmp_path / "a.obj", (20.0, HEIGHT)), np.stack([10 + out, 0.3 + 0 * out, 6.5 + 0 * out], 1), edge=1.6
    )
    assert np.abs(chart["presence"] - np.clip(0.5 - out / 1.6, 0, 1)).max() < 2e-3
    assert np.abs(chart["u"] - (20 + out)).max() < 1e-3
    assert np.abs(chart["height"] + 0.3).max() < 1e-5


@pytest.mark.nightly
def test_recipes_drape_cloth_over_a_body_and_refuse_one_without_it(tmp_path, monkeypatch):
    """The cloth hangs from a box of 12 mm: on its top and down to the floor, and not in it."""
    monkeypatch.setattr(drape, "POINTS", 20)
    trimesh.creation.box((10.0, 10.0, 12.0)).export(tmp_path / "a.ply")
    shape = {"form": "mesh", "file": str(tmp_path / "a.ply"), "height_mm": 12.0}
    record = {"kind": "cloth", "lay": "draped", "shape": shape, "width_mm": 36.0, "height_mm": 32.0, "voxel_mm": 0.25}
    record |= {"threads_per_cm": 10.0, "warp": {"diameter_mm": 0.5}, "material": FIBRE, "variants": 1}
    box = build(record)
    low, high = (1e3 * end for end in box.band)
    code = box.bricks.dense()[0].astype(float)
    index = np.argwhere((code > 2e-3) & (code < 0.999))
    height = low + code[tuple(index.T)] * (high - low)
    place = 1e3 * ((index[:, ::-1] + 0.5) * box.voxel_size + box.pose[:3, 3])[np.abs(height) < 0.2]
    assert 12.0 < place[:, 2].max() < 15.0 and place[:, 2].min() < 1.5
    assert not ((np.abs(place[:, :2]).max(axis=1) < 4.0) & (place[:, 2] < 11.5)).any()
    with pytest.raises(InputError, match=r'lay = "draped" or "mesh" and \[shape\] go together'):
        build({name: value for name, value in record.items() if name != "shape"})


@pytest.mark.nightly
def test_recipes_lay_cloth_and_knit_on_a_mesh_and_refuse_one_without_a_map(tmp_path):
    """Heights of the box are over the cylinder; a mesh of STL has no map."""
    shape = {"form": "mesh", "file": str(tube(tmp_path / "a.obj")), "height_mm": HEIGHT}
    record = {"kind": "cloth", "lay": "mesh", "shape": shape, "uv_mm": [50.0, HEIGHT], "voxel_mm": 0.25, "variants": 1}
    record |= {"threads_per_cm": 10.0, "warp": {"diameter_mm": 0.5}, "material": FIBRE}
    box = build(record)  # 50 mm of cloth around 50.27 mm, 25 periods of 2 mm: nothing to say
    low, high = (1e3 * end for end in box.band)
    code = box.bricks.dense()[0].astype(float)
    index = np.argwhere((code > 2e-3) & (code < 0.999))  # where heights are stored as they are
    place = 1e3 * ((index[:, ::-1] + 0.5) * box.voxel_size + box.pose[:3, 3])
    height = low + code[tuple(index.T)] * (high - low)
    truth, is_within = (
        np.linalg.norm(place[:, :2], axis=1) - RADIUS,
        np.abs(place[:, 2] - HEIGHT / 2) < HEIGHT / 2 - 0.1,
    )
    near = is_within & (np.abs(truth) < 1.4)
    assert near.sum() > 2000 and np.abs(height - truth)[near].max() < 0.02
    assert np.abs(height)[is_within & ~near].min() > 1.3
    mesh: Any = trimesh.load_mesh(shape["file"])
    mesh.export(tmp_path / "a.stl")
    with pytest.raises(InputError, match=r"a\.stl has no UV map for the cloth: unwrap the mesh"):
        build(record | {"shape": shape | {"file": str(tmp_path / "a.stl")}})
    level = sheet(np.linspace(0, 1, 9), np.linspace(0, 1, 8), lambda s, t: (20 * s, 13 * t, 0 * s))
    level.export(tmp_path / "level.obj")
    with pytest.raises(InputError, match="turn it upright by rotation_deg"):
        build(record | {"shape": shape | {"file": str(tmp_path / "level.obj")}})
    with pytest.raises(InputError, match="go together"):
        build(record | {"lay": "flat"})
