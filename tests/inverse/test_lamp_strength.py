"""Strength of lamps: from a matte reference and from a highlight that is not clipped, within their stated errors."""

import numpy as np
import pytest

from hagoromo.calibration.lamps import (
    find_highlight,
    find_matte_ball,
    highlight_strength,
    lamps_from_ball,
    matte_card,
    reference_strength,
)
from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError
from tests.inverse.simulated_mirror import (
    degrees_between,
    mask_of,
    mirror_photograph,
    pixels,
    seen_from_afar,
    seen_through,
    unit,
)

SHAPE = (151, 163)
STRENGTH = np.array([2.1, 1.7, 0.9])  # per channel: white at 0.9 albedo is at π / 0.9
ALBEDO = np.array([0.92, 0.9, 0.85])
ROOM = 0.01


def matte_photograph(ball, irradiance, seed, stain=0.0):
    """Light (h, w, 3) of a matte ball; irradiance: (h, w, 3) times the cosine. stain: share of the light it takes."""
    random = np.random.default_rng(seed)
    fine = np.where(ball.on[..., None], ALBEDO / np.pi * irradiance + ROOM, 0.05)
    light = np.stack([pixels(fine[..., c]) for c in range(3)], axis=2)
    light[60:75, 60:75] *= 1 - stain
    return light + random.normal(0, 1, light.shape) * np.hypot(0.002, 0.01 * np.sqrt(light))


def cosine(ball, towards):
    return np.maximum(np.sum(ball.normal * unit(towards), axis=-1), 0)[..., None]


@pytest.mark.parametrize("lamp", [(0.3, 0.2, 0.9), (-0.8, 0.3, 0.3)])
def test_a_matte_ball_tells_strength_colour_and_direction_of_a_far_lamp(lamp):
    """1 % of the strength is ten times what the noise of 6000 pixels leaves; a stain on 3 % of the ball is left out.

    Errors are within 3.5 of those stated (three channels, two lamps: once in 400). 0.5°: that of the mask's circle.
    """
    ball = seen_from_afar(SHAPE, (80.3, 74.9), 61.7)
    light = matte_photograph(ball, STRENGTH * cosine(ball, lamp), 3, stain=0.3)
    found = reference_strength(light, find_matte_ball(mask_of(ball), None, ALBEDO), unit(lamp))
    off = found.intensity / STRENGTH - 1
    assert np.abs(off).max() < 0.01
    assert (np.abs(found.intensity - STRENGTH) < 3.5 * found.standard_error + 1e-3 * STRENGTH).all()
    assert found.shading is not None and degrees_between(found.shading[0], lamp) < 0.5
    assert found.scatter < 0.05 and found.standard_error.max() < 0.02


def test_a_matte_ball_tells_the_strength_of_a_near_lamp():
    """Intensity is irradiance times distance squared, [m²]; 1 % as above."""
    camera = Camera(SHAPE[1], SHAPE[0], (300.0, 300.0), (81.0, 75.0)).look_at((0.0, -1.0, 0.1), (0.0, 0.0, 0.0))
    ball, position = seen_through(camera, np.array([0.02, 0.0, 0.01]), 0.2), np.array([0.4, -0.7, 0.5])
    offset = position - ball.place
    light = matte_photograph(ball, STRENGTH * cosine(ball, offset) / np.sum(offset**2, axis=-1, keepdims=True), 4)
    reference = find_matte_ball(mask_of(ball), camera, ALBEDO, radius=0.2)
    found = reference_strength(light, reference, None, position)
    np.testing.assert_allclose(found.intensity, STRENGTH, rtol=0.01)
    with pytest.raises(InputError, match="--reference-radius"):
        reference_strength(light, find_matte_ball(mask_of(ball), camera, ALBEDO), None, position)


def test_a_matte_card_tells_the_strength_of_a_far_lamp():
    random, normal, lamp = np.random.default_rng(5), unit([0.1, 0.2, 1.0]), unit([0.5, 0.1, 0.8])
    mask = np.zeros(SHAPE, np.uint8)
    mask[30:90, 40:140] = 255
    level = ALBEDO / np.pi * STRENGTH * (normal @ lamp)
    light = np.where(mask[..., None] > 0, level, 0.0) + random.normal(0, 0.01, (*SHAPE, 3))
    found = reference_strength(light, matte_card(mask, normal, ALBEDO), lamp)
    assert (np.abs(found.intensity - STRENGTH) < 3.5 * found.standard_error).all()
    assert found.standard_error.max() < 0.01 and found.shading is None


@pytest.mark.parametrize("seen", ["from afar", "through a camera"])
def test_a_highlight_that_is_not_clipped_tells_strength_by_its_light(seen):
    """E = ρ-corrected ∫ L dΩ; 2 %: the simulated image of the lamp is of some hundred rays."""
    mirror, half_width, radiance = 0.6, 0.15, 0.5
    if seen == "from afar":
        camera, ball, lamp = None, seen_from_afar(SHAPE, (80.3, 74.9), 61.7), unit([0.3, 0.4, 0.8])
    else:
        camera = Camera(SHAPE[1], SHAPE[0], (250.0, 250.0), (81.0, 75.0)).look_at((0.0, -1.0, 0.1), (0.1, 0.0, 0.0))
        ball, lamp = seen_through(camera, np.array([0.05, 0.0, 0.01]), 0.2), unit([0.3, -0.8, 0.4])
    numbers = mirror_photograph([ball], lamp, 6, half_width, white=65535, light=radiance, glow=1e-4)
    light = np.repeat(numbers[..., None] / 65535.0, 3, axis=2)
    found_ball, (reading,) = lamps_from_ball({"a": numbers}, mask_of(ball), camera)
    found = highlight_strength(light, found_ball, reading.highlight, mirror)
    truth = 2 * np.pi * (1 - np.cos(half_width)) * radiance / mirror
    np.testing.assert_allclose(found.intensity, truth, rtol=0.02)
    assert (np.abs(found.intensity - truth) < 3 * found.standard_error + 0.01 * truth).all()


def test_strength_is_refused_where_it_cannot_be_determined():
    ball, lamp = seen_from_afar(SHAPE, (80.3, 74.9), 61.7), unit([0.3, 0.2, 0.9])
    clipped = mirror_photograph([ball], lamp, 7, 0.06)
    light = np.where(clipped[..., None] == 255, np.nan, clipped[..., None] / 255.0).repeat(3, axis=2)
    mirror = lamps_from_ball({"a": clipped}, mask_of(ball))[0]
    with pytest.raises(InputError, match="it gives no strength"):
        highlight_strength(light, mirror, find_highlight(clipped, mirror), 0.6)
    matte = find_matte_ball(mask_of(ball), None, 0.9)
    bright = matte_photograph(ball, 4 * STRENGTH * cosine(ball, lamp), 8)
    for light, towards, said in [
        (np.where(bright > 1, np.nan, bright), lamp, "reference is clipped in [0-9]+ % of its lit pixels"),
        (bright, -lamp, "no visible pixel of the reference is lit by this lamp|does not brighten"),
    ]:
        with pytest.raises(InputError, match=said):
            reference_strength(light, matte, towards)
    with pytest.raises(InputError, match="reflectance is"):
        find_matte_ball(mask_of(ball), None, 90)
    with pytest.raises(InputError, match="white pixels"):
        matte_card(np.zeros(SHAPE), (0, 0, 1), 0.9)
