"""Relief: volume boxes show the surface that was measured, in perspective, and are sought only where it is."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import binary_erosion

from hagoromo.backend import arrays
from hagoromo.camera.camera import Camera
from hagoromo.camera.response import Response
from hagoromo.errors import InputError
from hagoromo.image.render import render
from hagoromo.image.scene.scene import Scene
from hagoromo.image.scene.settings import Settings
from hagoromo.image.scene.surface import Surface
from hagoromo.image.simulate import visible_shape
from hagoromo.light.lamp import Lamp
from hagoromo.light.spectrum import Spectrum
from hagoromo.matter.relief.relief import Relief, relief_plan
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
    inside = np.asarray(binary_erosion(relief.known(), iterations=3), np.bool_)  # whole pixels
    difference = (shown - true)[inside] / np.sqrt(np.mean(true[inside] ** 2))
    assert np.sqrt(np.mean(difference**2)) < 0.01


def test_two_materials_of_one_body_have_no_line_between_them():
    """Of other α, with body colours that make up for it: they look like one, to 1 %; of their own α a line shone."""
    _, relief = ball()
    materials = [replace(MATTE, beta=0.0), replace(MATTE, alpha=0.02, beta=0.0, body_colour=Spectrum.constant(10.0))]
    columns = np.arange(CAMERA.width)
    halves = replace(relief, labels=np.where(relief.labels >= 0, (columns > 70).astype(int), -1))
    one, two = (relief_plan(of, CAMERA, some).box() for of, some in ((relief, materials[:1]), (halves, materials)))
    assert CAMERA.response is not None
    alike, parted = (render(Scene(CAMERA, (LAMP,), (box,))).expose(CAMERA.response) for box in (one, two))
    inside = np.asarray(binary_erosion(relief.known(), iterations=3), np.bool_)
    assert np.abs(parted - alike)[inside].max() < 0.01 * alike[inside].max()


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


@pytest.mark.parametrize("height", [0.03, 0.1, 0.25])
def test_what_stands_before_another_surface_is_as_large_as_in_the_photograph(height):
    """A disc `height` [m] before a black wall 1 m away: its radius to 0.1 pixels, its edge within two. Matter falls
    to nothing over a voxel, and of an opaque skin nearly all of that is seen: the radius was 0.6 to 0.9 pixels too
    large.
    """
    camera = Camera(64, 60, (400.0, 400.0), (32.0, 30.0), response=Response.load("cie1931"))
    u, v = np.meshgrid(np.arange(64) + 0.5 - 32.0, np.arange(60) + 0.5 - 30.0)
    disc = np.hypot(u + 3.3, v - 2.1) < 15.0
    depth = np.where(disc, 1.0 - height, 1.0)
    points = np.stack([u / 400.0, v / 400.0, np.ones_like(u)], axis=2) * depth[..., None]
    matt = replace(MATTE, beta=0.0)
    facing = np.broadcast_to((0.0, 0.0, -1.0), points.shape)
    relief = Relief(points, facing, np.where(disc, matt.alpha, 0.0)[..., None] * np.ones(3), np.zeros(disc.shape, int))
    lamp = Lamp(to_lamp=(0.0, 0.0, -1.0), spectrum=Spectrum.named("E"))
    scene = Scene(camera, (lamp,), (relief_plan(relief, camera, [matt]).box(),))
    assert camera.response is not None
    image = render(scene, Settings(samples=16))
    shown = image.expose(camera.response)[..., 1]
    share = shown / np.median(shown[disc])
    assert abs(np.sqrt(share.sum() / np.pi) - np.sqrt(disc.sum() / np.pi)) < 0.1
    for side in (disc, ~disc):
        off_edge = np.asarray(binary_erosion(side, iterations=2, border_value=1), np.bool_)
        assert np.abs(share - disc)[off_edge].max() < 0.01  # f varies by 0.6 % over the disc
    assert image.alpha[2:-2, 2:-2].min() > 0.99  # no gap between the disc and the wall


def test_what_makes_no_relief_is_refused():
    _, relief = ball()
    for given, camera, said in [
        (replace(relief, labels=np.full_like(relief.labels, -1)), CAMERA, "nothing to fill"),
        (relief, replace(CAMERA, distortion=(0.1, 0.0, 0.0, 0.0)), "undistort them"),
        (relief, CAMERA.look_at((0.0, 0.35, 0.0), (0.0, 1.0, 0.0)), "behind the camera"),
    ]:
        with pytest.raises(InputError, match=said):
            plan_of(given, camera)
