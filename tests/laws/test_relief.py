"""Relief: volume boxes show the surface that was measured, in perspective, and are sought only where it is."""

from dataclasses import replace

import numpy as np
import pytest

from hagoromo.backend import arrays
from hagoromo.camera.camera import Camera
from hagoromo.camera.response import Response
from hagoromo.errors import InputError
from hagoromo.image.render import render
from hagoromo.image.scene import Scene
from hagoromo.image.settings import Settings
from hagoromo.image.simulate import visible_shape
from hagoromo.image.surface import Surface
from hagoromo.light.lamp import Lamp
from hagoromo.light.spectrum import Spectrum
from hagoromo.matter.solid.relief import Relief, relief_plan
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.volume.store.field_blocks import FieldBlocks
from hagoromo.volume.store.plan import BoxPlan

CAMERA = Camera(131, 127, (430.0, 430.0), (70.0, 60.0), response=Response.load("cie1931")).look_at(
    (0.02, -0.35, 0.03), (0.0, 0.0, 0.0)
)
MATTE = Reflectance(0.2, 0.1, 0.3, 1.5, Spectrum.constant(1.0))
LAMP = Lamp(position=(0.2, -0.5, 0.3), spectrum=Spectrum.named("E"))


def ball(camera: Camera = CAMERA) -> tuple[Scene, Relief]:
    surface = Surface.sphere((0.004, 0.0, -0.003), 0.04, MATTE, "ball")
    scene = Scene(camera, (LAMP,), surfaces=(surface,))
    shape = visible_shape(scene)
    body = np.where((shape.surface >= 0)[..., None], MATTE.alpha, 0.0) * np.ones(3)
    return scene, Relief(shape.points, shape.normals, body, shape.surface)


def plan_of(relief: Relief, camera: Camera = CAMERA) -> BoxPlan:
    return relief_plan(relief, camera, [MATTE])


def test_a_relief_in_perspective_shows_its_surface():
    """To 1 % of the light, which the steps of the march are told, under a near lamp."""
    scene, relief = ball()
    box = plan_of(relief).box()
    settings = Settings(samples=4, tolerance=0.01)
    assert CAMERA.response is not None
    true, shown = (render(one, settings).expose(CAMERA.response) for one in (scene, Scene(CAMERA, (LAMP,), (box,))))
    inside = relief.known()
    difference = (shown - true)[inside] / np.sqrt(np.mean(true[inside] ** 2))
    assert np.sqrt(np.mean(difference**2)) < 0.01


@pytest.mark.parametrize("focal", [430.0, 43.0])
def test_what_is_not_occupied_holds_no_matter(focal):
    """Everywhere on the lattice, for balls of the size of one brick and of many, through a long lens and a wide one."""
    camera = replace(CAMERA, focal=(focal, focal))
    if focal < 100:
        camera = camera.look_at((0.0, -0.075, 0.02), (0.0, 0.0, 0.0))
    field = plan_of(ball(camera)[1], camera).blocks
    assert isinstance(field, FieldBlocks) and field.occupied is not None
    jit, random = arrays(), np.random.default_rng(3)
    size = np.array(field.shape[::-1]) * field.voxel_size
    points = (random.random((200_000, 3)) * size).astype(np.float32)
    p = jit.Array3f(*(np.ascontiguousarray(points[:, k]) for k in range(3)))
    filled = np.array(field.field(p)[0]) > 0.0
    assert filled.sum() > 1000
    for radius in (0.5, 4.0, 31.0):  # voxels
        away = random.normal(size=points.shape)
        away /= np.linalg.norm(away, axis=1, keepdims=True)
        away *= radius * field.voxel_size * random.random((len(points), 1))
        middle = jit.Array3f(*(np.ascontiguousarray((points + away).astype(np.float32)[:, k]) for k in range(3)))
        may = np.array(field.occupied(middle, radius * field.voxel_size))
        assert may[filled].all()
        assert radius > 1.0 or not may.all()  # it does exclude


def test_boxes_are_the_same_however_they_are_sought():
    plan = plan_of(ball()[1])
    assert isinstance(plan.blocks, FieldBlocks)
    every = replace(plan, blocks=FieldBlocks(plan.blocks.field, plan.blocks.shape, plan.blocks.voxel_size))
    ours, all_of_them = plan.box(), every.box()
    images = [render(Scene(CAMERA, (LAMP,), (box,))).weights for box in (ours, all_of_them)]
    np.testing.assert_allclose(*images, rtol=1e-5, atol=1e-7)


def test_a_spike_is_brought_back():
    """One pixel, 2 cm before its surface."""
    _, relief = ball()
    points = relief.points.copy()
    middle = tuple(np.argwhere(relief.known()).mean(axis=0).astype(int))
    points[middle] += 0.02 * (CAMERA.position - points[middle]) / np.linalg.norm(CAMERA.position - points[middle])
    spiked, smooth = (plan_of(one).blocks.shape for one in (replace(relief, points=points), relief))
    assert spiked == smooth


def test_what_makes_no_relief_is_refused():
    _, relief = ball()
    for given, camera, said in [
        (replace(relief, labels=np.full_like(relief.labels, -1)), CAMERA, "nothing to fill"),
        (relief, replace(CAMERA, distortion=(0.1, 0.0, 0.0, 0.0)), "undistort them"),
        (relief, CAMERA.look_at((0.0, 0.35, 0.0), (0.0, 1.0, 0.0)), "behind the camera"),
    ]:
        with pytest.raises(InputError, match=said):
            plan_of(given, camera)
