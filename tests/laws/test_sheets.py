"""Laws of sheets: surfaces that let light through. Oracles: Lambert's law, the sum of a series, and mode path."""

import math

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.image.scene.modes import Mode

WHITE = hg.Spectrum.constant(1.0)
ACROSS = np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1.0]])  # a rectangle that faces −y


def camera(eye=(0, -3, 0)):
    return hg.Camera(8, 8, (200, 200), (4, 4)).look_at(eye, (0, 0, 0))


def sheet(back, through, y=0.0, half=1.0, colour=WHITE):
    """A matt rectangle that sends back and lets through these shares of the light."""
    matter = hg.Reflectance(back / math.pi, 0.0, 0.3, 1.5, WHITE, transmission=through, transmitted_colour=colour)
    pose = ACROSS @ np.diag([half, half, 1.0, 1.0])
    pose[1, 3] = y
    return hg.Surface(matter, "rectangle", pose=pose, name="sheet")


def light(scene, samples=64, wavelength=550.0, mode: Mode = "path"):
    """Mean of a picture, and its deviation, 0 of modes without noise."""
    image = hg.render(scene, hg.Settings(samples if mode == "path" else 4), mode=mode)
    spectra = np.array([colour.at(wavelength) for colour in image.palette.colours])
    noise = 0.0 if image.variance is None else math.sqrt(float(image.variance.mean()) / image.variance.size)
    return float((image.weights @ spectra).mean()), noise


@pytest.mark.parametrize("mode", ["march", "full", "path"])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_lamp_behind_a_sheet_shines_through_it_in_its_colour(side, mode):
    """Irradiance cos 60°, of which T c_t/π [1/sr] leaves by the far side, whichever side that is."""
    blue = hg.Spectrum([400, 700], [0.9, 0.1])
    scene = hg.Scene(camera((0, -3 * side, 0)), (hg.Lamp(to_lamp=(math.sqrt(0.75), 0.5 * side, 0)),),
                     surfaces=(sheet(0.3, 0.4, colour=blue),))  # fmt: skip
    for wavelength in (420.0, 680.0):
        expected = 0.4 * blue.at(wavelength) * 0.5 / math.pi
        assert light(scene, wavelength=wavelength, mode=mode)[0] == pytest.approx(expected, rel=1e-4)


def test_two_sheets_pass_what_goes_to_and_fro_between_them():
    """T²/(1 − R²) of the light behind, all orders; a sheet that does not transmit between them lets none pass."""
    pair = tuple(sheet(0.5, 0.4, y, half=3.0) for y in (0.0, 0.02))
    scene = hg.Scene(camera(), (hg.Lamp(to_lamp=(0, 1, 0)),), surfaces=pair)
    seen, deviation = light(scene, 1024)
    expected = 0.4**2 / (1 - 0.5**2) / math.pi
    assert abs(seen - expected) < 4.0 * deviation and deviation < 0.01 * expected
    wall = sheet(0.5, 0.0, 0.01, half=3.0)
    assert light(hg.Scene(camera(), scene.lamps, surfaces=(*pair, wall)))[0] == 0.0


@pytest.mark.parametrize("side", [-1, 1])
def test_full_follows_light_to_and_fro_between_sheets(side):
    """T²/(1 − R²) where the lamp is behind, R + T² R/(1 − R²) where it is on the side of the eye; within 2 %."""
    back, through = 0.5, 0.4
    pair = tuple(sheet(back, through, y, half=3.0) for y in (0.0, 0.02))
    scene = hg.Scene(camera((0, 3 * side, 0)), (hg.Lamp(to_lamp=(0, 1, 0)),), surfaces=pair)
    between = through**2 / (1 - back**2)
    expected = (between if side < 0 else back + between * back) / math.pi
    assert light(scene, mode="full")[0] == pytest.approx(expected, rel=0.02)


@pytest.mark.nightly
def test_march_and_full_show_a_cloud_under_a_sheet_as_path_does():
    """A lamp above a paper screen lights granules below it, all by light that the screen lets through: march shows the
    sheet's light alone, as path of one order does; the whole of full is within 5 % of path's.
    """
    granule, pose, side = hg.Reflectance(0.25, 0.0, 0.3, 1.5, WHITE, element="sphere"), np.eye(4), 10
    pose[:3, 3] = -0.2, 0.05, -0.2
    axes = np.broadcast_to((0.0, 0.0, 1.0), (side, side, side, 3))
    cloud = hg.VolumeBox.from_arrays(np.ones((side,) * 3), axes, 0.4 / side, 8.0, [granule], pose=pose)
    lamp = hg.Lamp(to_lamp=(0.0, -0.8, 0.6))
    screen = sheet(0.3, 0.6, half=0.6)
    below = hg.Camera(12, 12, (60, 60), (6, 6)).look_at((0, 2, 0), (0, 0, 0))
    scene = hg.Scene(below, (lamp,), (cloud,), surfaces=(screen,))
    seen = {mode: light(scene, 1024, mode=mode) for mode in ("march", "full", "path")}
    first = hg.render(scene, hg.Settings(256, orders=1), mode="path")
    spectra = np.array([colour.at(550.0) for colour in first.palette.colours])
    assert float((first.weights @ spectra).mean()) == pytest.approx(seen["march"][0], rel=0.02)
    assert seen["full"][0] > 2.0 * seen["march"][0]
    assert seen["full"][0] == pytest.approx(seen["path"][0], rel=0.05)
    assert seen["path"][1] < 0.01 * seen["path"][0]


def test_a_white_sheet_in_a_furnace_is_not_seen():
    sky = hg.Environment(np.ones((4, 8)), scale=1.0, visible=True)
    assert abs(light(hg.Scene(camera(), (), surfaces=(sheet(0.6, 0.4),), environment=sky), 256)[0] - 1.0) < 2e-3
