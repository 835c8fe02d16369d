"""Laws of sheets in mode path: surfaces that let light through. Oracles: Lambert's law, and the sum of a series."""

import math

import numpy as np
import pytest

import hagoromo as hg

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


def light(scene, samples=64, wavelength=550.0):
    image = hg.render(scene, hg.Settings(samples), mode="path")
    assert image.variance is not None
    spectra = np.array([colour.at(wavelength) for colour in image.palette.colours])
    return float((image.weights @ spectra).mean()), math.sqrt(float(image.variance.mean()) / image.variance.size)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_lamp_behind_a_sheet_shines_through_it_in_its_colour(side):
    """Irradiance cos 60°, of which T c_t/π [1/sr] leaves by the far side, whichever side that is."""
    blue = hg.Spectrum([400, 700], [0.9, 0.1])
    scene = hg.Scene(camera((0, -3 * side, 0)), (hg.Lamp(to_lamp=(math.sqrt(0.75), 0.5 * side, 0)),),
                     surfaces=(sheet(0.3, 0.4, colour=blue),))  # fmt: skip
    for wavelength in (420.0, 680.0):
        expected = 0.4 * blue.at(wavelength) * 0.5 / math.pi
        assert light(scene, wavelength=wavelength)[0] == pytest.approx(expected, rel=1e-4)


def test_two_sheets_pass_what_goes_to_and_fro_between_them():
    """T²/(1 − R²) of the light behind, all orders; a sheet that does not transmit between them lets none pass."""
    pair = tuple(sheet(0.5, 0.4, y, half=3.0) for y in (0.0, 0.02))
    scene = hg.Scene(camera(), (hg.Lamp(to_lamp=(0, 1, 0)),), surfaces=pair)
    seen, deviation = light(scene, 1024)
    expected = 0.4**2 / (1 - 0.5**2) / math.pi
    assert abs(seen - expected) < 4.0 * deviation and deviation < 0.01 * expected
    wall = sheet(0.5, 0.0, 0.01, half=3.0)
    assert light(hg.Scene(camera(), scene.lamps, surfaces=(*pair, wall)))[0] == 0.0


def test_a_white_sheet_in_a_furnace_is_not_seen():
    sky = hg.Environment(np.ones((4, 8)), scale=1.0, visible=True)
    assert abs(light(hg.Scene(camera(), (), surfaces=(sheet(0.6, 0.4),), environment=sky), 256)[0] - 1.0) < 2e-3
