"""The light of a relief's skin: under lamps that are high, low and behind, it is the light of the surface itself.

Truth: exact spheres and a fine mesh as surfaces of a scene, whose shadows Mitsuba's rays find. Errors are parts
of white, a matte surface that faces the lamp.
"""

from functools import cache

import numpy as np
import pytest
from scipy.ndimage import binary_erosion

from hagoromo.camera.camera import Camera
from hagoromo.camera.response import Response, camera_white
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
from hagoromo.volume.box import VolumeBox
from hagoromo.volume.store.header import header_from_record, header_record

EVEN = Spectrum.named("E")
EYE = Response.load("cie1931")
MATERIALS = {
    "matte": Reflectance(0.2, 0.0, 0.3, 1.5, Spectrum.constant(1.0)),
    "glossy": Reflectance(0.2, 0.8, 0.2, 1.5, Spectrum.constant(1.0)),
}
COARSE, FINE = 53, 83  # px
HIGH, MIDDLE, LOW = 70.0, 40.0, 15.0  # degrees above the horizon
SETTINGS = Settings(samples=4, tolerance=0.01)


def camera(side: int, aside: float = 0.0) -> Camera:
    """Above what stands around the origin, or so many degrees aside."""
    focal, angle = 6.6 * side, np.radians(aside)
    seen = Camera(side, side - 6, (focal, focal), (side / 2, side / 2 - 3), response=EYE)
    return seen.look_at((0.8 * np.sin(angle), 0.0, 0.8 * np.cos(angle)), (0.0, 0.0, 0.0), up=(0.0, 1.0, 0.0))


def lamp(elevation: float) -> Lamp:
    up, round_ = np.radians(elevation), np.radians(25.0)
    return Lamp(to_lamp=(np.cos(up) * np.cos(round_), np.cos(up) * np.sin(round_), np.sin(up)), spectrum=EVEN)


def sheet(material: Reflectance) -> Surface:
    """A wavy sheet, 12 mm from crest to trough, somewhat larger than what is seen."""
    side = np.linspace(-0.07, 0.07, 301)
    x, y = np.meshgrid(side, side)
    z = 0.006 * np.sin(2 * np.pi * x / 0.04) * np.cos(2 * np.pi * y / 0.06)
    first = (np.arange(300)[:, None] * 301 + np.arange(300)).ravel()
    squares = np.stack([first, first + 1, first + 302, first + 301], axis=1)
    faces = np.concatenate([squares[:, :3], squares[:, [0, 2, 3]]])
    return Surface(material, vertices=np.stack([x, y, z], axis=2).reshape(-1, 3), faces=faces)


def shapes(name: str, material: Reflectance) -> list[Surface]:
    if name == "sheet":
        return [sheet(material)]
    small = [Surface.sphere((0.01, 0.012, 0.045), 0.012, material)] if name == "balls" else []
    return [Surface.sphere((0.0, 0.0, 0.0), 0.04, material), *small]


@cache
def stood(name: str, of: str, side: int) -> tuple[tuple[Surface, ...], Relief, VolumeBox]:
    surfaces = tuple(shapes(name, MATERIALS[of]))
    shape = visible_shape(Scene(camera(side), (lamp(HIGH),), surfaces=surfaces))
    labels = np.minimum(shape.surface, 0)
    body = np.where((labels >= 0)[..., None], MATERIALS[of].alpha, 0.0) * np.ones(3)
    relief = Relief(shape.points, shape.normals, body, labels)
    return surfaces, relief, relief_plan(relief, camera(side), [MATERIALS[of]]).box()


def light(scene: Scene, settings: Settings = SETTINGS) -> np.ndarray:
    one = MATERIALS["matte"].alpha * camera_white(EVEN, EYE)[1]
    return render(scene, settings).expose(EYE)[..., 1].astype(float) / one


def shown_and_true(name: str, of: str, side: int, elevation: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Both pictures, and where to compare them: the same part of the surface, however many pixels show it."""
    surfaces, relief, box = stood(name, of, side)
    seen, lamps = camera(side), (lamp(elevation),)
    shown, true = light(Scene(seen, lamps, boxes=(box,))), light(Scene(seen, lamps, surfaces=surfaces))
    x, y, _ = np.moveaxis(relief.points, 2, 0)
    inside = relief.known() & (np.hypot(x, y) < 0.034)
    if name == "sheet":  # but for the shadows of crests that the camera does not see
        shadow = 0.012 / np.tan(np.radians(elevation)) * np.array([np.cos(np.radians(25.0)), np.sin(np.radians(25.0))])
        inside &= (x < 0.056 - shadow[0]) & (y < 0.05 - shadow[1])
    return shown, true, inside


@pytest.mark.parametrize("of", MATERIALS)
@pytest.mark.parametrize("elevation", [HIGH, MIDDLE, LOW])
def test_a_skin_shows_what_its_surface_shows(of, elevation):
    """To 1 % of white, which the steps of the march are told; and none where the lamp is more than 6° below the
    horizon: the ball bends by 5° over one pixel at its rim.
    """
    shown, true, inside = shown_and_true("ball", of, FINE, elevation)
    assert np.sqrt(np.mean((shown - true)[inside] ** 2)) < 0.01
    to_lamp = np.asarray(lamp(elevation).to_lamp)
    dark = inside & (stood("ball", of, FINE)[1].normals @ to_lamp < -np.sin(np.radians(6.0)))
    assert (dark.sum() > 50) == (elevation < HIGH)
    assert (shown[dark] < 1e-6).all()


@pytest.mark.parametrize("elevation", [HIGH, MIDDLE])
def test_a_hollow_shows_what_its_surface_shows(elevation):
    """Where a surface bends towards the lamp its skin must not shade itself: 1 % of white, as a ball's."""
    shown, true, inside = shown_and_true("sheet", "matte", FINE, elevation)
    assert np.sqrt(np.mean((shown - true)[inside] ** 2)) < 0.01


@pytest.mark.by_night("sheet-15.0")
@pytest.mark.parametrize(("name", "elevation"), [("sheet", LOW), ("balls", MIDDLE)])
def test_shadows_end_nearer_to_where_they_should_the_smaller_the_voxels(name, elevation):
    """They end a voxel off, about, as outlines do, and the mean error is of first order where voxels are small against
    all that bends: it falls by a factor from 1 to 2 when they are half as large. 1.3 tells that from none.
    """
    errors = []
    for side in (FINE, 2 * FINE):
        shown, true, inside = shown_and_true(name, "matte", side, elevation)
        errors.append(np.mean(abs(shown - true)[inside]))
    assert errors[0] < 0.02 and errors[1] < errors[0] / 1.3


def test_maps_find_the_shadows_that_a_march_finds():
    """Of one box, with what a ball throws on another: 1 % of white, half of what maps of an opaque skin are told."""
    box = stood("balls", "matte", COARSE)[2]
    scene = Scene(camera(COARSE), (lamp(MIDDLE),), (box,))
    mapped, marched = (light(scene, Settings(1, shadows, tolerance=0.01)) for shadows in ("map", "march"))
    assert np.sqrt(np.mean((mapped - marched)[marched > 0.0] ** 2)) < 0.01


def test_another_eye_sees_the_same_surface():
    """30° aside: nothing in a skin stands for the eye that measured it. 2 % of white: facets seen aslant overlap."""
    surfaces, _, box = stood("ball", "glossy", FINE)
    other = camera(FINE, aside=30.0)
    boxes, truth = (Scene(other, (lamp(MIDDLE),), boxes=(box,)), Scene(other, (lamp(MIDDLE),), surfaces=surfaces))
    shown, true = light(boxes), light(truth)
    whole = np.asarray(binary_erosion(render(boxes, SETTINGS).alpha > 0.99, iterations=4), np.bool_)
    assert whole.sum() > 1000
    assert np.sqrt(np.mean((shown - true)[whole] ** 2)) < 0.02


def test_a_shadow_bias_is_kept_in_files_and_must_be_a_length():
    box = stood("ball", "matte", COARSE)[2]
    record = header_record(box)
    assert header_from_record(record, "here").shadow_bias == box.shadow_bias > 0.0
    old = {"lift" if key == "shadow_bias" else key: value for key, value in record.items()}
    assert header_from_record(old, "here").shadow_bias == box.shadow_bias
    for wrong in (-1.0, float("nan")):
        with pytest.raises(InputError, match="shadow_bias is"):
            VolumeBox(box.bricks, box.voxel_size, box.tau, box.materials, shadow_bias=wrong)
