"""What is expected of a photograph under a further lamp: more, the farther the lamp is from those measured."""

import numpy as np
import pytest

from hagoromo.image.relight.forecast import forecast_of, outside_hull
from studies.forecasts import simulated_rows


def ring(away: float, count: int) -> np.ndarray:
    angle = 2.0 * np.pi * np.arange(count) / count
    return np.stack([np.sin(away) * np.cos(angle), np.sin(away) * np.sin(angle), np.full(count, np.cos(away))], axis=1)


@pytest.mark.parametrize("beyond", [0.0, 0.1, 0.4])
def test_a_lamp_is_as_far_outside_as_its_angle_from_the_cone(beyond):
    lamps = ring(0.5, 7)
    direction = np.array([np.sin(0.5 + beyond), 0.0, np.cos(0.5 + beyond)])  # beyond the first lamp, which is a corner
    assert outside_hull(lamps, direction) == pytest.approx(beyond, abs=1e-6)
    assert outside_hull(lamps, 3.0 * np.array([0.1, 0.05, 1.0])) == pytest.approx(0.0, abs=1e-7)


def test_errors_that_grow_are_forecast():
    random = np.random.default_rng(0)
    outside = np.concatenate([np.zeros(200), random.uniform(0.0, 0.3, 200)])
    errors = np.hypot(0.03, 0.2 * outside) * np.exp(0.35 * random.standard_normal(400))
    found = forecast_of(outside.tolist(), errors.tolist())
    # medians of 200 numbers of standard deviation 0.35: 3 % each; three of them
    assert found.inside == pytest.approx(0.03, rel=0.09)
    assert found.growth == pytest.approx(0.2, rel=0.12)
    assert found.error(0.5) == pytest.approx(np.hypot(0.03, 0.1), rel=0.12)


def test_one_photograph_that_is_far_off_says_little_of_others():
    outside = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.2, 0.25, 0.3]
    errors = np.hypot(0.01, 0.03 * np.array(outside))
    spoilt = forecast_of(outside, [*errors[:-1], 0.05])
    assert spoilt.error(0.0) == pytest.approx(0.01, rel=0.05)
    assert spoilt.error(0.6) == pytest.approx(np.hypot(0.01, 0.018), rel=0.1)


def test_half_of_the_photographs_are_nearer_than_expected_where_lamps_are_unequal():
    random = np.random.default_rng(1)
    lamps = 0.05 * random.standard_normal((2, 4000))
    expected = forecast_of([0.0], [0.02]).expected(0.3, np.abs(lamps[0]).tolist())
    # a share of 4000 trials, and one of the same size in the median that it is compared with: 3 √(2 · ¼ / 4000)
    assert np.mean(np.hypot(0.02, lamps[1]) < expected) == pytest.approx(0.5, abs=0.034)


def test_errors_that_do_not_grow_are_expected_outside_as_inside():
    outside = [0.0, 0.0, 0.1, 0.2]
    found = forecast_of(outside, [0.05, 0.05, 0.05, 0.05])
    assert found.error(0.5) == pytest.approx(0.05, rel=1e-6)
    assert forecast_of(outside, [0.05, 0.05, 0.02, 0.01]).growth == 0.0
    assert forecast_of([0.0], [0.0]).error(1.0) < 1e-9


@pytest.mark.nightly
def test_forecasts_of_a_glossy_object_hold_in_and_outside_the_hull_of_the_lamps():
    """The median of found / expected over photographs kept aside; highlights of the kind that is fitted."""
    rows = [row for row in simulated_rows(("lacquer",), 1) if row["set"] == "glossy, even lamps"]
    for outside in (False, True):
        ratios = [row["found"] / row["expected"] for row in rows if (row["outside_deg"] > 20.0) == outside]
        assert len(ratios) > 3 and 0.75 < np.median(ratios) < 1.25
