"""Materials by colour: an edge between two colours makes two, a smooth gradient of one colour makes one."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hagoromo.measurement.known_shape import measure_known_shape
from hagoromo.measurement.material.segment import _joined, segment
from tests.inverse.simulated_ball import BallMaterial, simulate

SIZE = 61
ANGLES = ((35, 20), (80, -15), (-40, 30), (-75, -10), (10, -60))
ROWS, COLUMNS = np.mgrid[:SIZE, :SIZE] / (SIZE - 1) * 2 - 1
RED, GREEN = np.array([0.20, 0.12, 0.08]), np.array([0.10, 0.18, 0.08])


def ball(share, seed=3, full_well=45_000.0):
    """A ball whose body is RED where `share` (h, w) is 0, GREEN where it is 1, and between them else."""
    body: Any = RED + np.asarray(share)[..., None] * (GREEN - RED)
    return simulate([BallMaterial(body, 0.3, 0.2, 1.5)], seed, SIZE, angles=ANGLES, full_well=full_well)


GRADIENTS = {
    "linear": 0.5 + 0.5 * COLUMNS,
    "levels": 0.5 + 0.5 * COLUMNS + 0.07 * np.sin(12 * COLUMNS),  # with broad and narrow ranges of colour
    "wave": 0.5 + 0.45 * np.sin(6 * ROWS),
    "spot": np.exp(-3 * (ROWS**2 + COLUMNS**2)),
}


@pytest.mark.parametrize("name", GRADIENTS)
@pytest.mark.parametrize("full_well", [4_000.0, 45_000.0])
def test_a_gradient_is_one_material(name, full_well):
    labels = segment(ball(GRADIENTS[name], full_well=full_well))
    assert set(np.unique(labels)) == {-1, 0}


@pytest.mark.parametrize("blur", [0.0, 0.8])
def test_two_colours_with_an_edge_are_two(blur):
    """Also where the camera blurs the edge over two pixels."""
    from scipy.ndimage import gaussian_filter

    share = (COLUMNS > 0.1).astype(float)
    labels = segment(ball(gaussian_filter(share, blur) if blur else share))
    assert labels.max() == 1
    known = labels >= 0
    assert max(np.mean((labels == k)[known] == (share > 0.5)[known]) for k in range(2)) > 0.95


def test_pixels_of_another_brightness_in_a_uniform_material_have_their_own_body():
    """A speck eight times as bright, of the same chromaticity: to 5 %; all else has the one colour of the material."""
    speck = np.hypot(ROWS + 0.1, COLUMNS - 0.2) < 0.09
    body: Any = np.where(speck[..., None], 8.0, 1.0) * (0.1 * RED)
    capture = simulate([BallMaterial(body, 0.3, 0.2, 1.5)], 3, SIZE, angles=ANGLES)
    found = measure_known_shape(capture, labels=np.where(segment(capture) >= 0, 0, -1))
    (material,) = found.materials
    assert found.body is not None and material.texture is not None and not material.texture["per_pixel"]
    value, known = found.body.value, found.labels == 0
    assert value[speck & known] == pytest.approx(np.broadcast_to(0.8 * RED, value[speck & known].shape), rel=0.05)
    assert np.ptp(value[~speck & known], axis=0) == pytest.approx(0.0, abs=1e-12) and (speck & known).sum() > 15


def test_a_cast_shadow_makes_no_hole():
    """A patch is in shadow in the photograph that its body colour would be read from, and lit in the others."""
    capture = ball((COLUMNS > 0.1).astype(float))
    plain, patch = segment(capture), (abs(ROWS) < 0.1) & (abs(COLUMNS - 0.4) < 0.1)
    for number, photograph in enumerate(capture.photographs):
        values = np.where(patch[..., None], 0.0, photograph.values)
        shadowed = replace(photograph, values=values)
        photographs = tuple(shadowed if k == number else one for k, one in enumerate(capture.photographs))
        labels = segment(replace(capture, photographs=photographs))
        assert (labels[patch] == plain[patch]).mean() > 0.95, number


def test_two_colours_that_do_not_touch_are_two():
    """Parted by a third: three materials, none of which is joined with another."""
    share = np.where(ROWS < -0.2, 0.0, np.where(ROWS > 0.2, 1.0, 0.5))
    assert segment(ball(share)).max() == 2


def test_stray_pixels_do_not_join_two_materials():
    """Two squares apart from each other; noise gave a few pixels of the one the other's label and half its colour."""
    labels, colours = np.full((70, 150), -1), np.full((70, 150, 2), np.nan)
    for number in range(2):
        square = slice(5, 65), slice(5 + 75 * number, 65 + 75 * number)
        labels[square], colours[square] = number, (0.07 * number, 0.0)
    labels[30:32, 30:32], colours[30:32, 30:32] = 1, (0.01, 0.0)
    assert _joined(labels, colours).max() == 1


def test_a_gradient_is_measured_as_one_material_of_a_colour_per_pixel():
    capture = ball(GRADIENTS["wave"])
    found = measure_known_shape(capture, n=1.5, facets="gaussian", interface="neutral")
    (material,) = found.materials
    assert material.texture is not None and material.texture["per_pixel"]
    assert abs(material.gamma / 0.2 - 1) < 0.05 and abs(material.beta / 0.3 - 1) < 0.15
    assert found.body is not None
    true = RED + GRADIENTS["wave"][..., None] * (GREEN - RED)
    known = np.isfinite(found.body.value).all(axis=2) & (found.labels >= 0)
    assert np.sqrt(np.mean((found.body.value / true - 1)[known] ** 2)) < 0.03
