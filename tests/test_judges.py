"""Each judge passes a true claim and refuses a false one; over many true claims it refuses as rarely as it says."""

import numpy as np
import pytest

from tests.judges import (
    alarms_are_rare,
    blocks_agree,
    converges_with_order,
    intervals_hold,
    mean_is,
    median_is,
    sampler_follows_density,
    standard_normal,
)

CELLS = np.linspace(0.0, 1.0, 41)


def draws_of_x(count=100_000, seed=1):
    """x of the density 2x on 0…1, by inversion: counts in 40 cells."""
    return np.histogram(np.sqrt(np.random.default_rng(seed).random(count)), CELLS)[0]


def test_chi_square_tells_a_density_from_its_neighbour():
    """Draws of 2x against 2x, and against a density that is 4 % steeper: cells expect 60 to 4,900 draws."""
    expected = 100_000 * np.diff(CELLS**2)
    assert sampler_follows_density(draws_of_x(), expected)
    assert not sampler_follows_density(draws_of_x(), 100_000 * np.diff(CELLS**2.08))
    assert not sampler_follows_density(draws_of_x(), 1.03 * expected)  # a density that does not integrate to 1
    assert sampler_follows_density(draws_of_x(), 1.03 * expected, expected_error=0.03)


def test_chi_square_joins_cells_that_expect_few():
    """4,000 draws: the first five cells expect 2.5 to 22. Draws where the density is 0 are refused nevertheless."""
    expected = 4_000 * np.diff(CELLS**2)
    assert sampler_follows_density(draws_of_x(4_000), expected)
    assert not sampler_follows_density(draws_of_x(4_000) + np.eye(40)[0] * 90, expected)
    assert sampler_follows_density([50, 50, 0], [50, 50, 0]) and not sampler_follows_density([50, 50, 60], [50, 50, 0])
    with pytest.raises(ValueError, match="1 cells expect 25 draws"):
        sampler_follows_density([3, 3], [3, 3])


def test_standard_errors_that_are_wrong_are_refused():
    """10,000 draws: 5 % of σ, a mean of 0.06 σ."""
    z = np.random.default_rng(2).standard_normal(10_000)
    assert standard_normal(z)
    assert not standard_normal(1.05 * z) and not standard_normal(0.95 * z) and not standard_normal(z + 0.06)
    assert standard_normal(1.05 * z, variance_tolerance=0.1) and standard_normal(z + 0.06, mean_tolerance=0.06)


def pictures(seed, shape=(37, 31, 3)):
    """Radiance with a slope, two noisy pictures of it, and the variance of their difference."""
    random = np.random.default_rng(seed)
    truth = np.broadcast_to(np.linspace(1.0, 3.0, shape[1])[None, :, None], shape)
    return truth + 0.1 * random.standard_normal(shape), truth + 0.2 * random.standard_normal(shape), 0.05 + 0 * truth


def test_blocks_tell_a_spot_and_a_faint_veil():
    """A spot of 3 pixels that is 40 % off, and 2 % everywhere, which no block shows alone: 80 blocks of 3 channels."""
    first, second, variance = pictures(3)
    assert blocks_agree(first, second, variance)
    spot = first.copy()
    spot[17:20, 12:15, 1] *= 1.4
    assert not blocks_agree(spot, second, variance)
    assert not blocks_agree(1.03 * first, second, variance)
    assert blocks_agree(1.03 * first, second, variance, relative_bias=0.03)
    assert not blocks_agree(first, second, variance / 2.0)  # a variance that is stated too small


def test_blocks_without_variance_must_be_equal():
    black = np.zeros((8, 8))
    assert blocks_agree(black, black, black)
    assert not blocks_agree(black + 1e-6, black, black)


def test_a_furnace_that_loses_a_hundredth_is_refused():
    """4,000 draws of uniform weights about 1, σ = 0.29: the mean is known to 0.5 %, and 0.97 is 6.5 of these away."""
    weights = np.random.default_rng(4).uniform(0.5, 1.5, 4_000)
    assert mean_is(weights, 1.0)
    assert not mean_is(0.97 * weights, 1.0) and mean_is(0.97 * weights, 1.0, tolerance=0.03)
    assert mean_is(np.ones(5), 1.0) and not mean_is(np.ones(5), 1.1)


def test_a_bias_of_the_median_is_refused_though_tails_are_long():
    """Cauchy draws, which have no mean: a shift of 0.4 of their half width moves 12 % of them over."""
    draws = np.random.default_rng(5).standard_cauchy(1_000)
    assert median_is(draws, 0.0)
    assert not median_is(draws + 0.4, 0.0) and not median_is(draws - 0.4, 0.0)
    assert median_is(draws + 0.4, 0.0, tolerance=0.4)


def test_intervals_that_are_too_narrow_or_too_wide_are_refused():
    """2,000 intervals of ±1.96 σ where σ is stated 15 % too small or too large: 90.4 and 97.6 % hold."""
    z = np.abs(np.random.default_rng(6).standard_normal(2_000))
    assert intervals_hold(z < 1.96)
    assert not intervals_hold(z < 0.85 * 1.96) and not intervals_hold(z < 1.15 * 1.96)
    assert intervals_hold(z < 1.15 * 1.96, at_least=True) and not intervals_hold(z < 0.85 * 1.96, at_least=True)
    assert intervals_hold(z < 1.15 * 1.96, tolerance=0.025)
    assert intervals_hold(z < 0.85 * 1.96, independent=100)  # of 100 intervals, 90 may hold by chance


def test_alarms_that_come_too_often_are_refused():
    """200 p-values of true claims; those of a test that overstates its evidence are p²."""
    p = np.random.default_rng(7).random(200)
    assert alarms_are_rare(p, 0.05) and not alarms_are_rare(p**2, 0.05)


def test_the_order_of_the_trapezoid_rule_is_two_and_not_three():
    steps = np.array([0.1, 0.05, 0.025, 0.0125])
    errors = [abs(np.trapezoid(np.exp(np.arange(0.0, 1.0 + h / 2, h)), dx=h) - np.expm1(1.0)) for h in steps]
    assert converges_with_order(steps, errors, 2) and not converges_with_order(steps, errors, 3)


@pytest.mark.parametrize("name", ["sampler", "normal", "blocks", "mean", "median", "intervals"])
def test_true_claims_are_refused_as_rarely_as_stated(name):
    """300 true claims at a significance of 5 %: alarms by `alarms_are_rare`'s own law (two tests a claim: 10 %)."""

    def verdict(seed):
        random = np.random.default_rng([seed, 8])
        if name == "sampler":
            return sampler_follows_density(draws_of_x(4_000, seed), 4_000 * np.diff(CELLS**2), 0.05)
        if name == "normal":
            return standard_normal(random.standard_normal(500), 0.05)
        if name == "blocks":
            return blocks_agree(*pictures(seed, (16, 16, 1)), significance=0.05)
        if name == "mean":
            return mean_is(random.standard_exponential(400), 1.0, 0.05)
        if name == "median":
            return median_is(random.standard_cauchy(300), 0.0, 0.05)
        return intervals_hold(random.random(400) < 0.95, significance=0.05)

    refused = sum(not verdict(seed) for seed in range(300))
    level = 0.1 if name in ("normal", "blocks") else 0.05
    assert alarms_are_rare(np.r_[np.zeros(refused), np.ones(300 - refused)], level), refused
