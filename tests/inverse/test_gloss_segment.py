"""Materials of one colour are told apart by their gloss, and one material is never two."""

from dataclasses import replace

import numpy as np
import pytest

from hagoromo.measurement.gloss.gloss_segment import split_by_gloss
from hagoromo.measurement.known_shape import measure_known_shape
from hagoromo.measurement.material.segment import segment
from hagoromo.measurement.observations import known_shape
from tests.inverse.simulated_ball import LAMPS, BallMaterial, reflected, simulate

RED = BallMaterial((0.20, 0.15, 0.10), 0.5, 0.15, 1.5)
SIZE = 101
SEVEN = ((35, 20), (80, -15), (130, 10), (-40, 30), (-75, -10), (10, 60), (-120, 5))
LEFT = np.repeat([0, 1], [50, 51])[None, :] * np.ones((SIZE, 1), int)


@pytest.mark.by_night("other0", "other1")
@pytest.mark.parametrize("other", [replace(RED, gamma=0.3), replace(RED, beta=0.15), replace(RED, beta=0.0)])
def test_two_glosses_of_one_colour_are_two_materials(other):
    """19 in 20 lit pixels at least carry the label of their own half: the border is as wide as a patch of pixels."""
    capture = simulate([RED, other], 5, SIZE, LEFT, SEVEN)
    colours = segment(capture)
    assert colours.max() == 0
    labels = split_by_gloss(capture, colours)
    assert labels.max() == 1
    first = (labels == 0)[labels >= 0] == (LEFT == 0)[labels >= 0]
    assert max(first.mean(), 1 - first.mean()) > 0.95


def test_both_are_measured():
    """γ of each within 3 %: pixels of the border that carry the other's label are outliers of the fit."""
    truths = (RED, replace(RED, gamma=0.3))
    found = sorted(measure_known_shape(simulate(truths, 6, SIZE, LEFT, SEVEN)).materials, key=lambda one: one.gamma)
    assert [one.gamma for one in found] == pytest.approx([0.15, 0.3], rel=0.03)


@pytest.mark.by_night("1.7-angles0")
@pytest.mark.parametrize("angles", [SEVEN, LAMPS])
@pytest.mark.parametrize("n", [1.3, 1.7])
def test_one_gloss_stays_one_whatever_its_refractive_index(angles, n):
    capture = simulate([replace(RED, n=n)], 7, SIZE, angles=angles)
    assert split_by_gloss(capture, np.where(known_shape(capture), 0, -1)).max() == 0


@pytest.mark.parametrize("angles", [SEVEN, LAMPS])
def test_a_lobe_of_another_shape_is_no_second_material(angles, monkeypatch):
    """Facets of GGX: no width fits both the middle and the tails, but under the same angles all pixels agree."""

    def heavy_tailed(normal, to_lamp, to_eye, truth):
        half = to_lamp + to_eye
        cos2 = ((normal * half).sum(-1) / np.linalg.norm(half, axis=-1)) ** 2
        phi2 = np.arccos(np.sqrt(np.clip(cos2, 0, 1))) ** 2
        ggx = (1 + (1 / np.maximum(cos2, 1e-9) - 1) * (0.644 / truth.gamma) ** 2) ** -2.0 / np.maximum(cos2, 1e-9) ** 2
        body = reflected(normal, to_lamp, to_eye, replace(truth, beta=0.0))
        flat = reflected(normal, to_lamp, to_eye, replace(truth, gamma=1e3)) - body
        return body + flat * np.where(phi2 < 1.2**2, ggx, 0.0)[..., None]

    monkeypatch.setattr("tests.inverse.simulated_ball.reflected", heavy_tailed)
    capture = simulate([replace(RED, gamma=0.2)], 1, SIZE, angles=angles)
    assert split_by_gloss(capture, np.where(known_shape(capture), 0, -1)).max() == 0


def test_two_photographs_tell_no_gloss_apart():
    capture = simulate([RED, replace(RED, gamma=0.3)], 5, SIZE, LEFT, SEVEN[:2])
    labels = segment(capture)
    np.testing.assert_array_equal(split_by_gloss(capture, labels), labels)
