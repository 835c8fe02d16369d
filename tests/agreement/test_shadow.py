"""Deep shadow maps agree with the brute march to 1 % (root mean square over the mean of the frame, its black part too).

Both march eight steps a voxel: at the usual two the brute march itself is up to 3 % from its limit in dense matter.
"""

import math

import drjit as dr
import numpy as np
import pytest

from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError
from hagoromo.image.render import render
from hagoromo.image.scene.scene import Scene
from hagoromo.image.scene.settings import Settings
from hagoromo.image.scene.surface import Surface
from hagoromo.light.lamp import Lamp
from hagoromo.light.spectrum import Spectrum
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.transport.lamp_view import LampViews
from hagoromo.volume.box import VolumeBox

WHITE = Spectrum.constant(1.0)
MATTER = Reflectance(0.25, 0.2, 0.25, 1.5, WHITE)
LAMPS = (Lamp(position=(0.5, -0.6, 0.7)), Lamp(position=(-0.6, -0.4, 0.3)), Lamp(to_lamp=(0.2, 0.5, 1.0)))
CAMERA = Camera(64, 48, (100.0, 100.0), (32.0, 24.0)).look_at((0, -0.6, 0.25), (0, 0, 0.03))


def ball(centre, radius, depth, count=64) -> VolumeBox:
    """A soft ball whose optical depth through the middle is `depth`."""
    size = 2.6 * radius

    def field(p):
        offset = p - 0.5 * size
        reach = dr.norm(offset)
        return dr.fmin(dr.fmax((radius - reach) / (0.2 * radius), 0.0), 1.0), offset / dr.fmax(reach, 1e-6)

    pose = np.eye(4)
    pose[:3, 3] = np.asarray(centre) - 0.5 * size
    return VolumeBox.from_field(field, (count, count, count), size / count, depth / (1.8 * radius), [MATTER], pose=pose)


def error(scene) -> float:
    settings = (Settings(shadows=shadows, tolerance=0.0025, shadow_resolution=640) for shadows in ("map", "march"))
    mapped, brute = (render(scene, s).weights for s in settings)
    assert not np.array_equal(mapped, brute)
    return float(np.sqrt(np.mean((mapped - brute) ** 2)) / brute.mean())


@pytest.mark.by_night("0.5-0.01", "100.0-0.01", "400.0-0.01", "0.5-0.04", "10.0-0.04")
@pytest.mark.parametrize("tolerance", [0.04, 0.01])
@pytest.mark.parametrize("depth", [0.5, 10.0, 100.0, 400.0])
def test_halving_the_tolerance_changes_the_picture_by_less(depth, tolerance):
    """Root mean square over the mean, both where there is matter, as is promised. In thin matter a step is a whole
    cell at both tolerances, and nothing changes.
    """
    boxes = ball((-0.05, 0, 0.06), 0.06, depth), ball((0.06, 0.01, 0.05), 0.05, depth)
    scene = Scene(CAMERA, LAMPS, boxes)
    image, finer = (render(scene, Settings(tolerance=t, shadow_resolution=640)) for t in (tolerance, tolerance / 2))
    a, b = (i.weights[finer.alpha > 1e-3] for i in (image, finer))
    change = np.sqrt(np.mean((a - b) ** 2)) / b.mean()
    assert change < tolerance and (change > 0.0 or depth < 1.0)


@pytest.mark.parametrize("depth", [0.5, 10.0, 100.0])
def test_maps_agree_with_the_brute_march_in_thin_and_dense_media(depth):
    boxes = ball((-0.05, 0, 0.06), 0.06, depth), ball((0.06, 0.01, 0.05), 0.05, depth)
    assert error(Scene(CAMERA, LAMPS, boxes)) < 0.01


def slab(low, high, half_width, depth, count, seed) -> VolumeBox:
    """A block of noise from z = low to high with hard faces; `depth`: its optical depth from top to bottom."""
    side = 2 * half_width / count
    shape = (round((high - low) / side), count, count)
    density = np.random.default_rng(seed).uniform(0.5, 1.5, shape).astype(np.float32)
    axis = np.broadcast_to(np.array([0, 0, 1], np.float32), (*shape, 3))
    pose = np.eye(4)
    pose[:3, 3] = -half_width, -half_width, low
    return VolumeBox.from_arrays(density, axis, side, depth / (high - low), [MATTER], pose=pose)


@pytest.mark.parametrize(("lamps", "bound"), [(LAMPS, 0.01), ((Lamp(position=(0.9, -0.2, 0.07)),), 0.02)])
@pytest.mark.parametrize("depth", [0.5, 10.0, 100.0])
def test_contacts_of_boxes_and_light_that_grazes_agree_with_the_brute_march(depth, lamps, bound):
    """A block on a plate, hard noisy faces, also under light 3° to 5° above them, at the tightest tolerance: errors
    over the mean where there is matter. Light that grazes enters by a fraction of a voxel: 1.4 %, not 1 %, is reached.
    """
    boxes = slab(0.0, 0.02, 0.1, depth, 48, 1), slab(0.02, 0.06, 0.04, depth, 32, 2)
    camera = Camera(64, 48, (150.0, 150.0), (32.0, 24.0)).look_at((0, -0.6, 0.35), (0, 0, 0.02))
    scene = Scene(camera, lamps, boxes)
    mapped, brute = (render(scene, Settings(4, shadows, tolerance=0.001)) for shadows in ("map", "march"))
    a, b = (image.weights[brute.alpha > 1e-3] for image in (mapped, brute))
    assert 0 < np.sqrt(np.mean((a - b) ** 2)) / b.mean() < bound


def test_dense_matter_under_a_map_that_is_coarser_than_its_voxels_has_no_bands():
    """A texel is six times too wide: a look-up behind a march of three voxels was 7 % off, where light grazes; now the
    march is longer by that factor.
    """
    scene = Scene(CAMERA, LAMPS[:1], (ball((0, 0, 0.03), 0.03, 60.0), ball((-0.2, 0.1, 0.2), 0.005, 60.0, 16)))
    mapped, brute = (render(scene, Settings(4, shadows, 128)).weights for shadows in ("map", "march"))
    assert np.sqrt(np.mean((mapped - brute) ** 2)) < 0.03 * brute.mean()


def test_a_box_shades_a_surface():
    floor = Surface.floor(0.0, 0.4, MATTER)
    assert error(Scene(CAMERA, LAMPS, (ball((0, 0, 0.07), 0.06, 30.0),), (floor,))) < 0.01


def test_a_surface_shades_a_box():
    """Behind a plate the ball is dark; beside its shadow it is as bright as without the plate."""
    scene = Scene(CAMERA, (Lamp(position=(0, 0, 1.0)),), (ball((0, 0, 0.06), 0.06, 30.0),))
    plate = Surface.floor(0.5, 0.2, MATTER)
    open_air, shaded = render(scene).weights, render(Scene(CAMERA, scene.lamps, scene.boxes, (plate,))).weights
    assert open_air.max() > 0.05 and shaded.max() == 0.0
    aside = Surface(MATTER, "rectangle", pose=_at((2.0, 0, 0.5), 0.2))
    assert np.allclose(render(Scene(CAMERA, scene.lamps, scene.boxes, (aside,))).weights, open_air, atol=1e-6)


def _at(centre, half_width):
    pose = np.diag([half_width, half_width, 1.0, 1.0])
    pose[:3, 3] = centre
    return pose


def test_surfaces_stand_before_and_behind_boxes():
    """A thin box in front of a plate: light of the plate is dimmed by exp(−τ), the matter's own is added."""
    depth = 0.5
    camera = Camera(9, 7, (60.0, 60.0), (4.5, 3.5)).look_at((0, 0, 1.0), (0, 0, 0.0), (0, 1, 0))
    shape, h = (16, 16, 16), 0.02
    pose = np.eye(4)
    pose[:3, 3] = (-0.16, -0.16, 0.1)
    black = Reflectance(0.0, 0.0, 0.2, 1.5, WHITE)
    fog = VolumeBox.from_field(lambda p: (1.0 + 0 * p.x, p), shape, h, depth / 0.32, [black], pose=pose)
    plate = Surface.floor(0.0, 1.0, Reflectance(0.2, 0.0, 0.2, 1.5, WHITE))
    lamps = (Lamp(to_lamp=(0.0, 0.0, 1.0)),)
    clear = render(Scene(camera, lamps, surfaces=(plate,)), Settings(shadows="none")).weights
    dim = render(Scene(camera, lamps, (fog,), (plate,)), Settings(shadows="none")).weights
    assert dim[3, 4].sum() == pytest.approx(math.exp(-depth) * clear[3, 4].sum(), rel=2e-3)
    shaded = render(Scene(camera, lamps, (fog,), (plate,))).weights  # and on its way in
    assert shaded[3, 4].sum() == pytest.approx(math.exp(-2 * depth) * clear[3, 4].sum(), rel=4e-3)


@pytest.mark.parametrize(
    ("lamp", "kind"),
    [(LAMPS[0], "pyramid"), (LAMPS[2], "lines"), (Lamp(position=(0.0, 0.0, 0.05)), "octahedron")],
)
def test_the_view_of_a_lamp_and_its_rays_are_inverse(lamp, kind):
    from hagoromo.backend import arrays

    corners = np.array([(x, y, z) for x in (-0.2, 0.2) for y in (-0.2, 0.2) for z in (0.0, 0.1)])
    view = LampViews([lamp], corners).of(0)
    assert view.kind == kind
    a, b = (arrays().Float(v) for v in np.random.default_rng(2).random((2, 4001)))
    origin, direction = view.ray(a, b)
    again_a, again_b, distance = view.place(origin + direction * 0.37)
    assert np.abs(np.array(again_a - a)).max() < 2e-5 and np.abs(np.array(again_b - b)).max() < 2e-5
    assert np.abs(np.array(distance) - 0.37).max() < 1e-5


def test_a_lamp_between_boxes_is_mapped_all_around():
    boxes = ball((-0.12, 0, 0.06), 0.05, 20.0), ball((0.12, 0, 0.06), 0.05, 20.0)
    assert error(Scene(CAMERA, (Lamp(position=(0.0, 0.0, 0.06), intensity=0.02),), boxes)) < 0.01


def test_a_lamp_inside_a_box_is_refused():
    scene = Scene(CAMERA, (Lamp(position=(0, 0, 0.06)),), (ball((0, 0, 0.06), 0.06, 30.0, 16),))
    for mode in ("march", "full"):
        with pytest.raises(InputError, match=r"stands inside the volume box.*mode path"):
            render(scene, mode=mode)


def test_a_camera_that_looks_away_is_refused():
    with pytest.raises(InputError, match="looks at nothing"):
        Scene(CAMERA.look_at((0, -0.6, 0.2), (0, -2.0, 0.2)), LAMPS, (ball((0, 0, 0.06), 0.06, 30.0, 16),))
