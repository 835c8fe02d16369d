"""Objects and rigs drawn at random for `recover`."""

import numpy as np
import pytest

from hagoromo.backend import vectors
from studies.drawn_objects import FORMS, conserves, drawn_object, drawn_rig
from studies.recover_scenes import RADIUS


@pytest.mark.parametrize("number", range(12))
def test_a_number_draws_a_whole_object_that_conserves_energy(number):
    draw = np.random.default_rng(number)
    truth, words = drawn_object(draw)
    again, same = drawn_object(np.random.default_rng(number))
    assert words == same and np.array_equal(truth.base, again.base)
    assert conserves((truth.beta, truth.gamma, truth.n), float((truth.base + truth.swing).max()))
    axis = np.linspace(-1.4 * RADIUS, 1.4 * RADIUS, 36)
    z, y, x = np.meshgrid(axis, axis, axis, indexing="ij")
    distance = np.array(truth.distance(vectors(np.stack([x, y, z], 3).reshape(-1, 3)))).reshape(x.shape)
    inside = np.argwhere(distance < 0.0)
    assert len(inside) > 20 and inside.min() > 0 and inside.max() < 35
    given, aside, _ = drawn_rig(draw)
    assert len(given.views) == len(given.lamps) >= 8 and all(len(lamps) for lamps in (*given.lamps, *aside.lamps))
    assert np.allclose(np.linalg.norm(given.views, axis=1), 1.0)


@pytest.mark.parametrize("name", list(FORMS))
def test_no_form_overstates_its_distance(name):
    """Rays would step over it."""
    form = FORMS[name](np.random.default_rng(1))
    points = np.random.default_rng(0).uniform(-0.06, 0.06, (2, 4000, 3))
    points[1] = points[0] + 1e-4 * np.random.default_rng(2).normal(size=(4000, 3))
    first, second = (np.array(form(vectors(each)), np.float64) for each in points)
    steep = np.abs(first - second) / np.linalg.norm(points[0] - points[1], axis=1)
    assert np.quantile(steep, 0.999) < 1.0 / 0.8  # of what a step goes
