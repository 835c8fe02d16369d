"""Veiling glare: a share of the mean of each photograph, found with its error; dark matter is as dark as it is."""

from dataclasses import replace

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.light.lamp import Lamp
from hagoromo.measurement.photometric.terms.glare import GLARE
from hagoromo.photograph.capture import Capture
from hagoromo.photograph.photograph import Photograph
from tests.inverse.simulated_ball import (
    DISTANCE,
    FULL_WELL,
    READ_NOISE,
    BallMaterial,
    ball_camera,
    ball_shape,
    reflected,
    simulate,
)

SIZE, SHARE = 41, 0.02
DARK, BRIGHT = BallMaterial((0.010, 0.015, 0.020), 0.5, 0.15, 1.5), BallMaterial((0.20, 0.15, 0.10), 0.3, 0.25, 1.4)
PARTS = np.repeat([0, 1], [26, 15]) * np.ones((SIZE, 1), int)  # the bright part is what scatters


def veiled(capture: Capture, share: float) -> Capture:
    """The photographs of a lens whose glare is `share` of the mean of the picture that it records."""
    means = [one.values.mean(axis=(0, 1), dtype=np.float64) / (1.0 - share) for one in capture.photographs]
    pairs = zip(capture.photographs, means, strict=True)
    return replace(capture, photographs=tuple(replace(one, values=one.values + share * mean) for one, mean in pairs))


def measured(share: float, seed: int) -> tuple[hg.Measurement, hg.Measurement]:
    """Measured as it is, and with the glare estimated."""
    capture = veiled(simulate([DARK, BRIGHT], seed, SIZE, labels=PARTS), share)
    plain = hg.measure(capture, facets="gaussian", interface="neutral")
    return plain, hg.measure(capture, facets="gaussian", interface="neutral", estimate=["glare"])


def dark_and_bright(found: hg.Measurement) -> list:
    return sorted(found.materials, key=lambda one: one.alpha)


def test_the_change_is_the_mean_of_the_frame_by_channel():
    """By hand: also beside the object, which the mask leaves out; values that are not finite do not count."""
    photograph = simulate([BRIGHT], 1, 11).photographs[0]
    values = photograph.values.copy()
    values[0, 0] = np.nan
    added = GLARE.change(replace(photograph, values=values)).added
    np.testing.assert_allclose(added, photograph.values.reshape(-1, 3)[1:].mean(axis=0), rtol=1e-6)


def test_two_per_cent_of_glare_are_found_and_the_dark_object_is_as_dark_as_it_is():
    """Without the term the dark body is 5 % too bright at least; with it within 4 of its errors, and below 1 %."""
    plain, found = measured(SHARE, 104)
    glare = found.terms["glare"]
    assert abs(glare.value - SHARE) < 3.0 * glare.standard_error < 0.1 * SHARE
    assert glare.determined and "veiling glare of the lens: 0.0" in found.assumptions["glare"]
    before, after = dark_and_bright(plain), dark_and_bright(found)
    assert before[0].alpha > 1.05 * DARK.alpha
    for one, truth in zip(after, (DARK, BRIGHT), strict=True):
        assert abs(one.alpha - truth.alpha) < min(4.0 * one.standard_error["alpha"], 0.01 * truth.alpha)
    bright = after[1]
    for key in ("beta", "gamma", "n"):
        assert abs(getattr(bright, key) - getattr(BRIGHT, key)) < 4.0 * bright.standard_error[key]
        assert abs(getattr(before[1], key) - getattr(BRIGHT, key)) > abs(getattr(bright, key) - getattr(BRIGHT, key))


def test_without_glare_there_is_none_and_all_else_is_as_before_but_for_its_error():
    """α of a dark body can be known no better than the glare on it: its error is larger than without the term."""
    plain, found = measured(0.0, 105)
    glare = found.terms["glare"]
    assert glare.value < 3.0 * glare.standard_error < 0.1 * SHARE
    for one, other in zip(dark_and_bright(plain), dark_and_bright(found), strict=True):
        assert abs(one.alpha - other.alpha) < 2.0 * other.standard_error["alpha"]
    (dark, bright), (dark_too, bright_too) = dark_and_bright(plain), dark_and_bright(found)
    for key in ("beta", "gamma", "n"):
        assert abs(getattr(bright, key) - getattr(bright_too, key)) < bright_too.standard_error[key]
    assert dark_too.standard_error["alpha"] > 1.2 * dark.standard_error["alpha"]


def far_ball(share: float, seed: int) -> Capture:
    """A ball of unknown shape under twelve far lamps, with glare and its shot noise."""
    random, camera = np.random.default_rng(seed), ball_camera(31)
    points, normals = ball_shape(camera)
    to_eye = camera.position - points
    to_eye /= np.linalg.norm(to_eye, axis=2, keepdims=True)
    photographs = []
    for k, (forward, turn) in enumerate(
        zip(np.linspace(0.97, 0.2, 12), np.pi * (1 + 5**0.5) * np.arange(12), strict=True)
    ):
        aside = np.sqrt(1.0 - forward**2)
        lamp = np.array([aside * np.cos(turn), -forward, aside * np.sin(turn)])
        light = reflected(normals, np.broadcast_to(lamp, normals.shape), to_eye, BRIGHT)
        light = np.where(np.linalg.norm(normals, axis=2, keepdims=True) > 0.5, light, 0.0)
        light = light + share / (1.0 - share) * light.mean(axis=(0, 1))
        exposure = 0.8 * FULL_WELL / light.max()
        electrons = random.poisson(light * exposure) + random.normal(0.0, READ_NOISE, light.shape)
        variance = (np.maximum(electrons, 0.0) + 1.0 + READ_NOISE**2) / exposure**2
        mask = np.linalg.norm(normals, axis=2) > 0.5
        photographs.append(Photograph(electrons / exposure, variance, mask, camera, (Lamp(to_lamp=lamp),), f"lamp {k}"))
    return Capture(tuple(photographs), "ball")


@pytest.mark.by_night("0.02")
@pytest.mark.parametrize("share", [pytest.param(0.0, marks=pytest.mark.nightly), SHARE])
def test_pixels_of_unknown_shape_find_it_too(share):
    """Normals, bodies, gloss and lamps are free as well, yet shadows show it."""
    glare = hg.measure(
        far_ball(share, 7), distance=DISTANCE, estimate=["glare"], facets="gaussian", interface="neutral"
    ).terms["glare"]
    assert abs(glare.value - share) < 3.0 * glare.standard_error < 0.1 * SHARE
