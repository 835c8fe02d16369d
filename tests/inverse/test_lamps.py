"""Lamps from a chrome ball: directions are found within their own stated errors, simulated and real."""

from pathlib import Path

import numpy as np
import pytest

from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError
from hagoromo.files.png import read_png
from hagoromo.photograph.lamps import calibrate_lamps

REAL = Path(__file__).parents[3] / "shared" / "data" / "uw_psm"
HEIGHT, WIDTH, RADIUS = 233, 271, 104.3  # px, a little coarser than the real ball of uw_psm
CENTRE = (133.2, 114.7)
FINE = 4  # rays a pixel along each axis
LAMPS = [(0.5, 0.47, 0.73), (-0.04, 0.17, 0.98), (-0.6, -0.4, 0.69), (0.1, 0.56, 0.82), (0.7, -0.6, 0.2)]
WIDTH_OF_LAMP = np.radians(4.0)  # half its angle, as seen from the ball


def unit(vectors):
    return np.asarray(vectors, float) / np.linalg.norm(vectors, axis=-1, keepdims=True)


def degrees_between(a, b):
    return np.degrees(np.arccos(np.clip(np.sum(unit(a) * unit(b), axis=-1), -1, 1)))


def pictures(normal, to_eye, on_ball, seed):
    """One 8-bit photograph a lamp (saturated, with a dim room and noise) and the mask of the ball, antialiased."""
    random = np.random.default_rng(seed)
    mirrored = 2 * np.sum(normal * to_eye, axis=-1, keepdims=True) * normal - to_eye

    def pixels(fine):
        return fine.reshape(HEIGHT, FINE, WIDTH, FINE).mean(axis=(1, 3))

    photographs = {}
    for number, lamp in enumerate(unit(LAMPS)):
        angle = np.arccos(np.clip(mirrored @ lamp, -1, 1))
        light = 2000.0 * (angle < WIDTH_OF_LAMP) + 30.0 * np.exp(-((angle / 0.2) ** 2)) + 4.0
        noisy = pixels(np.where(on_ball, light, 1.0)) + random.normal(0, 1, (HEIGHT, WIDTH))
        photographs[f"lamp {number}"] = np.clip(np.rint(noisy), 0, 255).astype(np.uint8)
    return photographs, np.rint(255 * pixels(on_ball.astype(float))).astype(np.uint8)


def fine_grid():
    """Image points (x, y) of FINE × FINE rays a pixel."""
    row, column = np.mgrid[: HEIGHT * FINE, : WIDTH * FINE]
    return np.stack([(column + 0.5) / FINE, (row + 0.5) / FINE], axis=-1)


def test_lamps_on_a_simulated_ball_are_found_within_a_third_of_a_degree():
    """0.3° is a quarter of a pixel on this ball; each error is also within 3 of its stated standard errors."""
    x, y = np.moveaxis((fine_grid() - CENTRE) / RADIUS, -1, 0)
    on_ball = x**2 + y**2 < 1
    normal = np.stack([x, -y, np.sqrt(np.maximum(1 - x**2 - y**2, 0))], axis=-1)
    ball, lamps = calibrate_lamps(*pictures(normal, np.array([0.0, 0.0, 1.0]), on_ball, seed=1))
    np.testing.assert_allclose((*ball.centre, ball.radius), (*CENTRE, RADIUS), atol=0.1)  # px: a tenth of a pixel
    for lamp, truth in zip(lamps, LAMPS, strict=True):
        off = degrees_between(lamp.to_lamp, truth)
        assert off < 0.3 and off < 3 * lamp.standard_error_deg, lamp.name
        assert lamp.standard_error_deg < 1.0


def test_lamps_are_found_through_a_camera_in_perspective():
    """The ball fills 30° of the view: as an orthographic picture it would mislead by degrees. Same tolerance."""
    camera = Camera(WIDTH, HEIGHT, (400.0, 390.0), (128.0, 119.0), (-0.1, 0.02, 0.0, 0.0, 0.0)).look_at(
        (1.0, -3.0, 0.5), (0.0, 0.0, 0.1)
    )
    ray, eye = camera.unproject(fine_grid()), camera.position
    centre, radius = np.array([0.1, 0.05, 0.12]), 0.8
    along = ray @ (centre - eye)
    root = along**2 - np.sum((centre - eye) ** 2) + radius**2
    point = eye + ray * (along - np.sqrt(np.maximum(root, 0)))[..., None]
    photographs, mask = pictures(unit(point - centre), -ray, root > 0, seed=2)
    towards = [number for number, lamp in enumerate(unit(LAMPS)) if lamp @ unit(eye - centre) > -0.3]
    seen = {name: photograph for number, (name, photograph) in enumerate(photographs.items()) if number in towards}
    _, lamps = calibrate_lamps(seen, mask, camera)
    assert len(lamps) >= 2
    for number, lamp in zip(towards, lamps, strict=True):
        off = degrees_between(lamp.to_lamp, LAMPS[number])
        assert off < 0.3 and off < 3 * lamp.standard_error_deg, lamp.name


@pytest.mark.skipif(not REAL.is_dir(), reason="the photographs of uw_psm are not beside this repository")
def test_real_chrome_ball_agrees_with_an_independent_reading():
    """The set's own reading from this ball has errors of its own, of about a pixel of its radius: 0.5°."""
    photographs = {f"{k}": read_png(REAL / "chrome" / f"chrome.{k}.png") for k in range(12)}
    _, lamps = calibrate_lamps(photographs, read_png(REAL / "chrome" / "chrome.mask.png"))
    text = (REAL / "lights_from_chrome_ball_by_lab.txt").read_text().split("\n")
    theirs = np.array([[float(n) for n in line.split()] for line in text if len(line.split()) == 3])
    off = degrees_between(np.array([lamp.to_lamp for lamp in lamps]), theirs)
    assert off.max() < 0.55
    assert all(lamp.standard_error_deg < 0.3 for lamp in lamps)


def test_photographs_that_show_no_lamp_are_refused():
    row, column = np.mgrid[:HEIGHT, :WIDTH]
    disc = np.where(np.hypot(column - 130, row - 115) < 80, 255, 0).astype(np.uint8)
    dark, white = np.zeros_like(disc), np.full_like(disc, 255)
    speck = np.where(np.hypot(column - 120, row - 110) < 3, 255, 0).astype(np.uint8)
    square = np.zeros_like(disc)
    square[30:190, 40:230] = 255
    for photographs, mask, said in [
        ({"a": dark}, disc, "a: no highlight"),
        ({"a": white}, disc, "a: no highlight"),
        (
            {"a": np.where(column > 60, disc, 0).astype(np.uint8) // 2 + speck // 2},
            disc,
            "no highlight|highlight covers",
        ),
        ({"a": speck}, np.roll(disc, 90, axis=1), "cut by the edge"),
        ({"a": speck}, dark, "mask is black"),
        ({"a": speck}, square, "no disc"),
        ({"a": speck}, speck, "move closer"),
        ({"a": speck[1:]}, disc, "make them fit"),
        ({}, disc, "no photograph"),
    ]:
        with pytest.raises(InputError, match=said):
            calibrate_lamps(photographs, mask)
