"""What is expected of a photograph under a further lamp: more, the farther the lamp is from those measured."""

import numpy as np
import pytest

from hagoromo.image.relight.forecast import forecast_of, outside_hull


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
    errors = np.hypot(0.03, 0.2 * outside) * np.sqrt(random.chisquare(8.0, 400) / 8.0)
    found = forecast_of(outside.tolist(), errors.tolist())
    # a and b by 200 squares each, whose relative standard deviation is ½: 2 % of a², a few of b²; three of them, halved
    assert found.inside == pytest.approx(0.03, rel=0.08)
    assert found.growth == pytest.approx(0.2, rel=0.12)
    assert found.error(0.5) == pytest.approx(np.hypot(0.03, 0.1), rel=0.12)


def test_errors_that_do_not_grow_are_expected_outside_as_inside():
    outside = [0.0, 0.0, 0.1, 0.2]
    found = forecast_of(outside, [0.05, 0.05, 0.05, 0.05])
    assert found.error(0.5) == pytest.approx(0.05, rel=1e-6)
    assert forecast_of(outside, [0.05, 0.05, 0.02, 0.01]).growth == 0.0
    assert forecast_of([0.0], [0.0]).error(1.0) == 0.0
