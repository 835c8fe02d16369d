"""Laws of place: a scene looks the same wherever it stands in the world, and from and under whatever is far away.

Offsets are exact in double precision. Before scenes were counted from an origin of their own, the pictures of the first
test differed by 0.014 % (100 m), 15 % (10 km) and 21 % (1000 km).
"""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from hagoromo.backend import arrays
from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError
from hagoromo.image.preview import Preview
from hagoromo.image.ray_march import RayMarch
from hagoromo.image.render import render
from hagoromo.image.scene.origin import camera_from
from hagoromo.image.scene.scene import Scene
from hagoromo.image.scene.settings import Settings
from hagoromo.image.scene.surface import Surface
from hagoromo.image.simulate import visible_shape
from hagoromo.light.lamp import Lamp
from hagoromo.light.spectrum import Spectrum
from hagoromo.measurement.surface.depth import points_from_normals
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.volume.box import VolumeBox

WHITE = Spectrum.constant(1.0)
MATTE = Reflectance(0.2, 0.3, 0.3, 1.5, WHITE)
FELT = replace(MATTE, element="cylinder")
OFFSETS = {"100 m": (100.0, -64.0, 30.0), "10 km": (1e4, -8e3, 5e3), "1000 km": (1e6, -7e5, 3e5)}
EYE, TARGET = np.array((0.36, -0.42, 0.3)), np.array((0.06, 0.06, 0.03))


@cache
def felt() -> VolumeBox:
    rng, shape = np.random.default_rng(3), (31, 29, 27)
    bricks = np.kron(rng.random((4, 4, 4)) > 0.4, np.ones((8, 8, 8)))[:31, :29, :27]
    axis = rng.normal(size=(*shape, 3))
    axis /= np.linalg.norm(axis, axis=-1, keepdims=True)
    return VolumeBox.from_arrays(rng.random(shape) * bricks, axis, 0.004, 150.0, [FELT])


def placed(offset) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, 3] = offset
    return pose


def tetrahedron(offset=(0.0, 0.0, 0.0)) -> Surface:
    corners = np.array([(0.2, 0.1, 0.0), (0.3, 0.1, 0.0), (0.22, 0.2, 0.0), (0.24, 0.13, 0.1)])
    faces = np.array([(0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)])
    return Surface(MATTE, vertices=corners + offset, faces=faces, smooth=False)


def scene_at(offset=(0.0, 0.0, 0.0), farther=1.0, width=61, height=47) -> Scene:
    """A box, a mesh and a floor under a spot and a far lamp; the camera is `farther` away, and longer."""
    offset, focal = np.asarray(offset, float), 80.0 * farther
    camera = Camera(width, height, (focal, focal), (width / 2, height / 2))
    camera = camera.look_at(offset + TARGET + farther * (EYE - TARGET), offset + TARGET)
    lamps = (
        Lamp(position=np.add(offset, (-0.4, -0.3, 0.5)), axis=(0.4, 0.3, -0.5), axis_power=3.0),
        Lamp(to_lamp=(0.2, -0.3, 1.0)),
    )
    floor = replace(Surface.floor(0.0, 0.5, MATTE), pose=placed(offset - (0, 0, 0.01)) @ np.diag([0.5, 0.5, 1.0, 1.0]))
    return Scene(camera, lamps, (felt().with_pose(placed(offset)),), (tetrahedron(offset), floor))


def difference(one, other) -> float:
    """Root mean square over that of the other."""
    return float(np.sqrt(((one - other) ** 2).mean() / (other**2).mean()))


@pytest.mark.parametrize("shadows", ["map", "march"])
@pytest.mark.parametrize("offset", OFFSETS)
def test_a_scene_looks_the_same_wherever_it_stands(offset, shadows):
    settings = Settings(shadows=shadows)
    there, here = render(scene_at(OFFSETS[offset]), settings), render(scene_at(), settings)
    assert difference(there.weights, here.weights) < 1e-5 and difference(there.alpha, here.alpha) < 1e-5
    assert np.allclose(
        there.metadata["scene"]["camera"]["world_to_camera"], scene_at(OFFSETS[offset]).camera.world_to_camera
    )


@pytest.mark.parametrize("offset", OFFSETS)
def test_surfaces_alone_and_their_true_shape_stand_where_they_are(offset):
    here, there = (replace(scene_at(place), boxes=()) for place in ((0.0, 0.0, 0.0), OFFSETS[offset]))
    assert difference(render(there).weights, render(here).weights) < 1e-5
    shape, moved = visible_shape(here), visible_shape(there)
    seen = shape.surface >= 0
    assert np.array_equal(moved.surface, shape.surface) and seen.mean() > 0.3
    assert np.abs(moved.points[seen] - shape.points[seen] - OFFSETS[offset]).max() < 1e-6  # m, of 1e6 m
    assert np.abs(moved.normals - shape.normals).max() < 1e-6 and not moved.points[~seen].any()


def test_the_preview_ends_in_the_render_far_away():
    there = scene_at(OFFSETS["10 km"], width=31, height=23)
    *_, last = Preview(Settings()).pictures(there)
    assert np.array_equal(last.weights, render(there).weights)


def test_single_rays_are_followed_from_where_they_are_in_double_precision():
    direction = (TARGET - EYE) / np.linalg.norm(TARGET - EYE)
    eyes = EYE + np.linspace(0.0, 0.05, 7)[:, None] * (1.0, 0.0, 0.0)
    one = (Lamp(to_lamp=(0.2, -0.3, 1.0)),)
    here, there = (
        RayMarch(replace(scene_at(offset), lamps=one, surfaces=())) for offset in ((0, 0, 0), OFFSETS["10 km"])
    )
    ways, places = np.tile(direction, (7, 1)), eyes + OFFSETS["10 km"]
    true = here(eyes, ways)
    assert true.weights.max() > 0.0 and np.allclose(there(places, ways).weights, true.weights, rtol=1e-5, atol=1e-6)
    jit = arrays()
    double = jit.Array3f64(np.ascontiguousarray(places.T))
    light, _ = there.along(double, jit.Array3f(*(float(each) for each in direction)))
    assert np.allclose(np.stack([np.array(one) for one in light], axis=1), true.weights, rtol=1e-5, atol=1e-6)


def test_matter_far_behind_the_camera_changes_nothing():
    """Another box 14 km away, and a floor 60 km wide: places are exact where the camera looks.

    Places within STEP / 2 voxels of the origin are exact to 2.4e-4 of a voxel, and the density of this box changes by
    its own size within a voxel or two.
    """
    true = render(scene_at(), Settings(shadows="march"))
    far = scene_at(OFFSETS["10 km"])
    two = render(replace(far, boxes=(*far.boxes, felt())), Settings(shadows="march"))
    assert difference(two.weights, true.weights) < 2.4e-4
    mapped = render(replace(far, boxes=(*far.boxes, felt())), Settings(shadows="map"))  # a texel would be 15 m wide
    assert np.array_equal(mapped.weights, two.weights)
    near, floor = (
        scene_at(),
        replace(Surface.floor(-2.0, 3e4, MATTE), pose=placed((0, 0, -2)) @ np.diag([3e4, 3e4, 1, 1])),
    )
    there = scene_at((1000.0, -800.0, 0.0))
    wide = [render(replace(s, surfaces=(*s.surfaces, floor))).weights for s in (near, there)]
    assert difference(wide[1], wide[0]) < 1e-5


def test_a_camera_far_away_sees_what_one_farther_away_sees():
    """Parallax falls as 1 / distance. Before, pictures from 60 km and from 600 km differed by 77 %."""
    near, far = (render(scene_at(farther=away)) for away in (1e6, 1e8))
    assert near.alpha.max() == 1.0 and difference(near.weights, far.weights) < 1e-4


def test_a_lamp_far_away_is_a_far_lamp():
    """Its light differs by the order of size / distance; before, maps were off by 0.7 % (10 km) and 15 % (1000 km)."""
    scene, way = scene_at(), np.array((0.2, -0.3, 1.0)) / np.sqrt(1.13)
    limit = render(scene.with_lamps(Lamp(to_lamp=way))).weights
    for away, error in ((1e4, 5e-5), (1e6, 5e-6), (1e9, 5e-6)):
        lamp = Lamp(position=TARGET + away * way, intensity=away**2)
        assert difference(render(scene.with_lamps(lamp)).weights, limit) < error


def test_a_box_finer_than_double_precision_can_place_is_refused():
    for box, surfaces in ((felt().with_pose(placed((5e11, 0, 0))), ()), (felt(), (tetrahedron((5e11, 0, 0)),))):
        with pytest.raises(InputError, match=r"stands 5e\+11 m from \(0, 0, 0\).*nearer"):
            replace(scene_at(), boxes=(box,), surfaces=surfaces)


def test_a_mesh_whose_file_rounded_it_away_is_reported(tmp_path):
    """Single precision keeps 1 mm at 10 km: 1 % of this mesh."""
    import trimesh

    trimesh.Trimesh(tetrahedron(OFFSETS["10 km"]).vertices, tetrahedron().faces, process=False).export(
        tmp_path / "far.ply"
    )
    with pytest.warns(UserWarning, match=r"far\.ply.*single precision"):
        Surface.from_file(tmp_path / "far.ply", MATTE)
    trimesh.Trimesh(tetrahedron().vertices, tetrahedron().faces, process=False).export(tmp_path / "near.ply")
    Surface.from_file(tmp_path / "near.ply", MATTE)


def test_points_from_normals_stand_where_the_camera_sees_them():
    """A plane 1 m in front of a camera 10 km out: single precision would move its points by up to 0.5 mm."""
    here = Camera(17, 13, (20.0, 20.0), (8.5, 6.5)).look_at((0.0, -1.0, 0.0), (0.0, 0.0, 0.0))
    there = camera_from(here, -np.array(OFFSETS["10 km"]))
    normals = np.broadcast_to(np.array((0.0, -1.0, 0.0), np.float32), (13, 17, 3))
    points, moved = (points_from_normals(normals, camera, 1.0) for camera in (here, there))
    assert np.abs(points[..., 1]).max() < 1e-3
    assert np.abs(moved - points - OFFSETS["10 km"]).max() < 1e-9
