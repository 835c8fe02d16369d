"""Significance of maps: the rate of false discoveries is the stated one, also where neighbours err alike."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from scipy.stats import binom, false_discovery_control

from hagoromo_campaigns.significance import false_discovery_threshold, significant
from hagoromo_campaigns.trend import trend

SHAPE = (61, 53)
RATE = 0.05


def _noise(random, width, count=3):
    """(h, w, k) of variance 1 whose neighbours are correlated over `width` px."""
    noise = random.standard_normal((*SHAPE, count))
    if width:
        noise = gaussian_filter(noise, (width, width, 0), mode="wrap") * 2.0 * np.sqrt(np.pi) * width
    return noise


def test_the_threshold_is_that_of_scipy():
    p = np.random.default_rng(1).random(997) ** 3
    threshold = false_discovery_threshold(p, RATE)
    np.testing.assert_array_equal(p <= threshold, false_discovery_control(p) <= RATE)


@pytest.mark.parametrize("width", [0.0, 1.5])
def test_nothing_is_found_in_noise(width):
    """In 30 maps without a change, at most as many show one as a rate of 5 % allows, at its 99.9 % quantile."""
    random = np.random.default_rng(2)
    some = [significant(_noise(random, width), np.ones((*SHAPE, 3)), RATE).found.any() for _ in range(30)]
    assert sum(some) <= binom.ppf(0.999, 30, RATE)


def test_of_what_is_found_few_places_did_not_change():
    """A change of two errors in a quarter of a map: few of the places found lie beyond the reach of its neighbours."""
    random, false, found = np.random.default_rng(3), 0, 0
    truth = np.zeros(SHAPE, bool)
    truth[10:40, 8:35] = True
    near = gaussian_filter(truth.astype(float), 2.0) > 1e-3
    for _ in range(10):
        tested = significant(_noise(random, 0.0) + 2.0 * truth[..., None], np.ones((*SHAPE, 3)), RATE)
        false, found = false + (tested.found & ~near).sum(), found + tested.found.sum()
        assert tested.found[truth].mean() > 0.8
    assert false <= RATE * found


def test_errors_that_are_stated_too_small_are_widened():
    tested = significant(3.0 * _noise(np.random.default_rng(4), 0.0), np.ones((*SHAPE, 3)), RATE)
    assert not tested.found.any() and abs(tested.widening[0] - 3.0) < 0.15  # 3233 values: 2 % of a robust spread, twice
    tested = significant(0.3 * _noise(np.random.default_rng(4), 0.0), np.ones((*SHAPE, 3)), RATE)
    assert tested.widening == (1.0, 1.0, 1.0)  # never narrowed


def test_a_trend_is_what_most_of_a_map_follows():
    random = np.random.default_rng(5)
    y, x = np.meshgrid(np.linspace(-1, 1, SHAPE[0]), np.linspace(-1, 1, SHAPE[1]), indexing="ij")
    truth = (0.3 + 0.2 * x - 0.1 * y)[..., None]
    values = truth + 0.01 * _noise(random, 0.0, 1)
    values[5:25, 5:25] += 1.0  # an eighth of it changed
    found, coefficients = trend(values, np.full_like(values, 1e-4), 1)
    assert np.abs(found - truth).max() < 0.002 and coefficients.shape == (3, 1)
