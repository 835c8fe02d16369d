"""What is said where photographs do not fix the gloss."""

import numpy as np
import pytest

from hagoromo_recovery.descent.gloss_step import Slopes
from hagoromo_recovery.errors import Errors
from hagoromo_recovery.evidence import Evidence, _in_its_place
from hagoromo_recovery.shading.shading import coordinates, two_glosses

GLOSS = coordinates(0.5, 0.2, 1.5)
SHAPE = 3, 4, 5


@pytest.mark.parametrize(("spread", "least"), [(0.2, 0.5 * np.exp(-1.96 * 0.2)), (0.8, 0.0)])
def test_a_weight_that_is_not_identifiable_may_be_none(spread, least):
    (material,) = Evidence(np.eye(3) * spread**2, np.ones(SHAPE, np.int32)).materials(GLOSS)
    low, high = material["interval_95"]["beta"]
    assert low == pytest.approx(least, rel=1e-3) and high == pytest.approx(0.5 * np.exp(1.96 * spread), rel=1e-3)
    assert material["identifiable"]["beta"] == (least > 0.0)


@pytest.mark.parametrize(("spread", "share"), [(0.2, 0.2), (3.0, 1.0)])
def test_body_colours_are_in_doubt_by_the_share_of_the_gloss_that_is(spread, share):
    """By all of its light at most."""
    instead = np.full((*SHAPE, 3, 1), 0.05, np.float32)
    known = Evidence(np.eye(3) * spread**2, np.ones(SHAPE, np.int32), in_its_place=instead)
    assert np.allclose(known.colour_doubt(GLOSS), 0.05 * share)
    nowhere = np.full(SHAPE, np.nan, np.float32)
    errors = Errors(nowhere, nowhere, np.full((*SHAPE, 3), 0.03, np.float32), np.zeros(SHAPE, bool))
    assert np.allclose(errors.with_colour_doubt(known.colour_doubt(GLOSS)).colour, np.hypot(0.03, 0.05 * share))


def test_of_two_glosses_the_squares_are_added_and_their_order_is_kept():
    instead = np.zeros((*SHAPE, 3, 2), np.float32)
    instead[..., 0], instead[..., 1] = 0.03, 0.04
    covariance = np.diag([1.0, 0.0, 0.0, 4.0, 0.0])
    known = Evidence(covariance, np.ones(SHAPE, np.int32), in_its_place=instead)
    assert np.allclose(known.colour_doubt(two_glosses(GLOSS)), 0.05)
    turned = known.in_order([3, 4, 2, 0, 1])
    assert turned.in_its_place is not None and np.allclose(turned.in_its_place[..., 0], 0.04)


def test_the_body_colour_in_its_place_sends_the_light_of_the_gloss():
    """Places of which each pixel has 0.3 of its light by colour from the gloss; means over neighbours keep that."""
    random = np.random.default_rng(0)
    by_colour = random.uniform(0.5, 2.0, (400, 3))
    by_gloss = np.zeros((400, 3, 3))
    by_gloss[..., 0] = 0.3 * by_colour
    node = random.integers(0, int(np.prod(SHAPE)), 400)
    slopes = Slopes(by_gloss, by_colour, np.zeros((400, 3)), node, np.zeros(400, np.int64))
    assert np.allclose(_in_its_place(slopes, [0], SHAPE), 0.3, atol=1e-6)
