"""What is expected of a photograph under a further lamp: more, the farther the lamp is from those measured."""

import numpy as np
import pytest

from hagoromo.image.relight.forecast import (
    LEAST_MISFIT,
    Forecast,
    Missed,
    ShownLight,
    forecast_of,
    leverage,
    outside_hull,
    own_leverages,
)
from studies.forecasts import simulated_rows
from studies.glossy_objects import GLOSSY

ZENITH = np.array([0.0, 0.0, 1.0])
BRIGHT = ShownLight(1.0, 1.0)


def ring(away: float, count: int) -> np.ndarray:
    angle = 2.0 * np.pi * np.arange(count) / count
    return np.stack([np.sin(away) * np.cos(angle), np.sin(away) * np.sin(angle), np.full(count, np.cos(away))], axis=1)


def towards(away: float) -> np.ndarray:
    return np.array([np.sin(away), 0.0, np.cos(away)])


@pytest.mark.parametrize("beyond", [0.0, 0.1, 0.4])
def test_a_lamp_is_as_far_outside_as_its_angle_from_the_cone(beyond):
    lamps = ring(0.5, 7)
    assert outside_hull(lamps, towards(0.5 + beyond)) == pytest.approx(beyond, abs=1e-6)
    assert outside_hull(lamps, 3.0 * np.array([0.1, 0.05, 1.0])) == pytest.approx(0.0, abs=1e-7)


def test_the_leverage_is_by_how_much_a_fit_passes_on_the_errors_of_its_photographs():
    """Values n·l of a matt pixel, n by least squares, with errors of 1: that of a further value has the variance h."""
    random = np.random.default_rng(2)
    lamps, further = ring(0.6, 11), towards(1.2)
    errors = np.linalg.lstsq(lamps, random.standard_normal((11, 40_000)), rcond=None)[0].T @ further
    # 40,000 squares of normal numbers: 0.7 %; three of them
    assert leverage(lamps, 2.0 * further) == pytest.approx(errors.var(), rel=0.021)
    assert own_leverages(lamps).sum() == pytest.approx(3.0)
    rest = np.delete(lamps, 4, axis=0)
    own = own_leverages(lamps)[4]
    assert own / (1.0 - own) == pytest.approx(leverage(rest, lamps[4]))


def photographs(lamps: np.ndarray, misfit: float, growth: float, noise: float, scatter: np.ndarray) -> list[Missed]:
    """One under each of the lamps, left out, as the forecast has them."""
    missed = []
    for k, lamp in enumerate(lamps):
        rest = np.delete(lamps, k, axis=0)
        squared = misfit**2 * (1.0 + leverage(rest, lamp)) * (1.0 + (growth * outside_hull(rest, lamp) ** 2) ** 2)
        missed.append(Missed(k, noise**2 + squared * float(np.exp(scatter[k])) ** 2, noise**2))
    return missed


LAMPS = np.concatenate([ZENITH[None], ring(0.2, 60), ring(0.35, 70), ring(0.6, 5), ring(0.9, 5)])


def test_errors_that_grow_are_forecast():
    scatter = 0.1 * np.random.default_rng(0).standard_normal(len(LAMPS))
    found = forecast_of(LAMPS, photographs(LAMPS, 0.03, 30.0, 0.02, scatter), (0.0, 0.02**2))
    # a median of 131 photographs inside of standard deviation 0.1: 1 %; b by the five outside: three times 7 %
    assert found.misfit == pytest.approx(0.03, rel=0.04)
    assert found.growth == pytest.approx(30.0, rel=0.21)
    further = towards(1.3)
    true = (1.0 + leverage(LAMPS, further)) * (1.0 + (30.0 * outside_hull(LAMPS, further) ** 2) ** 2)
    assert found.error(further, BRIGHT) == pytest.approx(np.hypot(0.02, 0.03 * np.sqrt(true)), rel=0.21)
    # of half the light the errors are as large, noise but 0.7 times: relative to it they are larger
    assert found.error(further, ShownLight(0.5, 0.25)) == pytest.approx(2.0 * np.sqrt(2e-4 + 9e-4 * true), rel=0.21)


def test_errors_that_do_not_grow_are_expected_outside_as_the_leverage_has_them():
    found = forecast_of(LAMPS, photographs(LAMPS, 0.03, 0.0, 0.0, np.zeros(len(LAMPS))))
    assert found.growth == 0.0
    for away in (0.3, 1.3):
        inflated = np.sqrt(1.0 + leverage(LAMPS, towards(away)))
        assert found.error(towards(away), BRIGHT) == pytest.approx(0.03 * inflated, rel=1e-6)


def test_photographs_that_are_off_by_their_noise_let_expect_little_else():
    found = forecast_of(LAMPS, [Missed(k, 4e-4, 4e-4) for k in range(len(LAMPS))], (4e-4, 0.0))
    assert found.misfit < 0.02 * LEAST_MISFIT
    assert found.error(ZENITH, BRIGHT) == pytest.approx(0.02, rel=0.01)
    assert forecast_of(LAMPS, [Missed(0, 0.0, 0.0)]).error(towards(1.0), BRIGHT) < 1e-9


def test_one_photograph_that_is_far_off_says_little_of_others():
    missed = photographs(LAMPS, 0.01, 0.0, 0.0, np.zeros(len(LAMPS)))
    spoilt = forecast_of(LAMPS, [*missed[:-1], Missed(len(LAMPS) - 1, 0.2**2, 0.0)])
    assert spoilt.error(ZENITH, BRIGHT) == pytest.approx(0.01, rel=0.05)
    assert spoilt.error(towards(1.3), BRIGHT) < 0.015


def test_half_of_the_photographs_are_nearer_than_expected_where_lamps_are_unequal():
    random = np.random.default_rng(1)
    lamps = 0.05 * random.standard_normal((2, 4000))
    expected = Forecast(ring(0.5, 7), 0.02, 0.0).expected(towards(0.6), BRIGHT, np.abs(lamps[0]).tolist())
    inflated = np.sqrt(1.0 + leverage(ring(0.5, 7), towards(0.6)))
    # a share of 4000 trials, and one of the same size in the median that it is compared with: 3 √(2 · ¼ / 4000)
    assert np.mean(inflated * np.hypot(0.02, lamps[1]) < expected) == pytest.approx(0.5, abs=0.034)


@pytest.mark.nightly
def test_forecasts_of_glossy_objects_hold_in_and_outside_the_hull_of_the_lamps():
    """The median of found / expected over photographs kept aside; highlights of the kind that is fitted. Of one object
    seven photographs are inside or near, and where highlights are clipped in some of them only, their median is that
    of chance (lacquer: 1.35).
    """
    rows = [row for row in simulated_rows(sorted(GLOSSY), 1) if row["set"] == "glossy, even lamps"]
    for outside in (False, True):
        ratios = [row["found"] / row["expected"] for row in rows if (row["outside_deg"] > 20.0) == outside]
        assert len(ratios) > 20 and 0.8 < np.median(ratios) < 1.25
