"""Statistical judges: each decides one kind of claim from samples, at a significance that the caller states.

A judge returns a `StatisticalVerdict`: `assert judge(…)` passes where the null hypothesis ("the claim is true")
stands, and prints the figures where it falls. The significance is the chance that a true claim is refused. Give a
fixed seed to what draws the samples, and decide count and significance before the first run. `tests/test_judges.py`
shows each judge a true claim, which it must pass, and a false one, which it must refuse.

| judge | claim |
|---|---|
| `sampler_follows_density` | counts of draws per cell follow a density (chi-square) |
| `standard_normal` | standardised errors have mean 0 and variance 1 |
| `blocks_agree` | two pictures with variance show the same radiance (Z per block) |
| `mean_is` | the mean of independent draws is a stated value (t-test; furnace) |
| `median_is` | the median of independent draws is a stated value (sign test), or is near it |
| `intervals_hold` | intervals hold the truth as often as they say (binomial), or at least as often |
| `alarms_are_rare` | p-values of true claims fall below a level no more often than stated (binomial) |
| `converges_with_order` | errors fall as a power of the step |
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats

SIGNIFICANCE = 1e-3  # chance that a judge refuses a true claim, unless the test states another one
LEAST_EXPECTED = 25.0  # counts of a cell: the Poisson law is close to normal, so that chi-square holds


@dataclass(frozen=True)
class StatisticalVerdict:
    """Whether a claim stands, the probability of samples as far from it or farther, and the figures behind it."""

    stands: bool
    p_value: float
    figures: str

    def __bool__(self) -> bool:
        return self.stands


def sampler_follows_density(
    counts: ArrayLike, expected: ArrayLike, significance: float = SIGNIFICANCE, expected_error: float = 0.0
) -> StatisticalVerdict:
    """Judge a sampler by Pearson's chi-square, Σ (counts − expected)²/expected over the cells.

    Null hypothesis: independent draws fall into a cell with its expected share. counts, expected: (cells), numbers of
    draws; the expected ones are the integral of the density over a cell, times the draws, and need not add up to them.
    Cells that expect fewer than 25 draws are joined into one. expected_error: relative error of `expected` (of its
    quadrature), which is added to the variance. Draws: some 100 a cell tell densities apart that differ by 10 % in it.
    Degrees of freedom: cells − 1. Source: Pearson, Philosophical Magazine 50 (1900) 157, doi 10.1080/14786440009463897.
    """
    counts, expected = np.asarray(counts, float).ravel(), np.asarray(expected, float).ravel()
    few = expected < LEAST_EXPECTED
    counts, expected = np.append(counts[~few], counts[few].sum()), np.append(expected[~few], expected[few].sum())
    if (
        len(counts) > 1 and expected[-1] < LEAST_EXPECTED
    ):  # too few in all of them: what they expect goes to the last full cell
        counts[-2:], expected[-2:] = (counts[-2:].sum(), 0.0), (expected[-2:].sum(), 0.0)
        counts, expected = counts[:-1], expected[:-1]
    if len(counts) < 2:
        raise ValueError(
            f"{len(counts)} cells expect {LEAST_EXPECTED:g} draws or more: draw more, or give larger cells"
        )
    chi_square = float(np.sum((counts - expected) ** 2 / (expected + (expected_error * expected) ** 2)))
    p = float(stats.chi2.sf(chi_square, len(counts) - 1))
    return StatisticalVerdict(
        p > significance, p, f"χ² {chi_square:.1f} of {len(counts) - 1} degrees of freedom, p {p:.2g}"
    )


def standard_normal(
    z: ArrayLike,
    significance: float = SIGNIFICANCE,
    mean_tolerance: float = 0.0,
    variance_tolerance: float = 0.0,
) -> StatisticalVerdict:
    """Judge standardised errors, (estimate − truth)/σ: two-sided tests of the mean (normal) and variance (chi-square).

    Null hypothesis: z are independent draws of mean 0 and variance 1. Tolerances are what is granted beside chance: of
    the mean in standard deviations, of the variance as a share of 1; state their reason. Each of the two tests has the
    stated significance. Draws: n tell the mean to 1/√n and the variance to √(2/n).
    """
    z = np.asarray(z, float).ravel()
    mean, variance, count = float(z.mean()), float(z.var(ddof=1)), z.size
    p_mean = 2.0 * float(stats.norm.sf(max(abs(mean) - mean_tolerance, 0.0) * math.sqrt(count)))
    low, high = stats.chi2.ppf((significance / 2, 1.0 - significance / 2), count - 1) / (count - 1)
    within = low - variance_tolerance < variance < high + variance_tolerance
    figures = f"mean {mean:.4f} (p {p_mean:.2g}), variance {variance:.4f} (allowed {low:.4f} to {high:.4f})"
    return StatisticalVerdict(p_mean > significance and bool(within), p_mean, f"{figures}, {count} draws")


def blocks_agree(
    first: ArrayLike,
    second: ArrayLike,
    variance: ArrayLike,
    block: int = 4,
    significance: float = SIGNIFICANCE,
    relative_bias: float = 0.0,
) -> StatisticalVerdict:
    """Judge two pictures block by block: Z = (mean of first − mean of second)/σ of the difference, in each block.

    Null hypothesis: both show the same radiance in every block, with independent normal errors of the stated variance.
    first, second: (height, width[, channel]), the same unit; variance: of their difference, (height, width[, channel]),
    the sum of the two pictures' own variances. relative_bias: share of the second picture by which the first may
    differ systematically (of a step, of a table); it is taken off the difference. The largest |Z| of m blocks is judged
    with Šidák's correction, 1 − (1 − significance)^(1/m), and Σ Z² by chi-square, which sees small errors everywhere.
    Each of the two tests has the stated significance. Blocks without variance must be equal.
    Source: Šidák, Journal of the American Statistical Association 62 (1967) 626, doi 10.1080/01621459.1967.10482935.
    """
    first, second, variance = np.asarray(first, float), np.asarray(second, float), np.asarray(variance, float)
    difference, noise = (_block_means(values, block) for values in (first - second, variance))
    allowed = relative_bias * np.abs(_block_means(second, block))
    excess = np.maximum(np.abs(difference) - allowed, 0.0)
    samples = np.broadcast_to(_block_sizes(first.shape, block), noise.shape)
    certain = noise <= 0.0
    z = excess[~certain] / np.sqrt(noise[~certain] / samples[~certain])
    farthest = float(z.max(initial=0.0))
    p_farthest = -math.expm1(z.size * math.log1p(-2.0 * float(stats.norm.sf(farthest)))) if farthest > 0.0 else 1.0
    p_all = float(stats.chi2.sf(np.sum(z**2), z.size)) if z.size else 1.0
    equal = not (excess[certain] > 0.0).any()
    p = min(p_farthest, p_all) if equal else 0.0
    figures = (
        f"{z.size} blocks: largest |Z| {farthest:.2f} (p {p_farthest:.2g}), Σ Z² {np.sum(z**2):.1f} (p {p_all:.2g})"
    )
    return StatisticalVerdict(p > significance, p, figures if equal else f"{figures}; blocks without variance differ")


def mean_is(
    draws: ArrayLike, truth: float, significance: float = SIGNIFICANCE, tolerance: float = 0.0
) -> StatisticalVerdict:
    """Judge the mean of draws by Student's t, two-sided; with draws of radiance in a white furnace, its energy.

    Null hypothesis: independent draws whose mean is `truth`, within `tolerance` (the unit of the draws; state why). The
    law of large numbers makes them normal enough from some 30 draws on. n draws tell the mean to σ/√n: choose n so
    that a wrong mean that matters is 5 of these away.
    Source: Student, Biometrika 6 (1908) 1, doi 10.1093/biomet/6.1.1.
    """
    draws = np.asarray(draws, float).ravel()
    mean, spread = float(draws.mean()), float(draws.std(ddof=1)) / math.sqrt(draws.size)
    off = max(abs(mean - truth) - tolerance, 0.0)
    p = 2.0 * float(stats.t.sf(off / spread, draws.size - 1)) if spread > 0.0 else float(off == 0.0)
    return StatisticalVerdict(
        p > significance, p, f"mean {mean:.6g} ± {spread:.2g} of {draws.size}, truth {truth:.6g}, p {p:.2g}"
    )


def median_is(
    draws: ArrayLike, truth: float, significance: float = SIGNIFICANCE, tolerance: float = 0.0
) -> StatisticalVerdict:
    """Judge the median bias of an estimator by the sign test, two-sided.

    Null hypothesis: half of the independent draws lie on either side of a value within `tolerance` of `truth` (the
    draws' unit; state why). Needs no law of the errors, so it suits ratios with long tails. n draws tell the share
    on one side to 1/(2√n): 200 tell a median from one that 60 % of the draws exceed.
    """
    draws = np.asarray(draws, float).ravel()
    above, below = int(np.sum(draws > truth + tolerance)), int(np.sum(draws < truth - tolerance))
    most = max(above, below)
    p = min(1.0, 2.0 * float(stats.binom.sf(most - 1, draws.size, 0.5)))
    figures = (
        f"median {np.median(draws):.6g} of {draws.size}, truth {truth:.6g}: {above} above, {below} below, p {p:.2g}"
    )
    return StatisticalVerdict(p > significance, p, figures)


def intervals_hold(
    hits: ArrayLike,
    level: float = 0.95,
    significance: float = SIGNIFICANCE,
    at_least: bool = False,
    tolerance: float = 0.0,
    independent: float | None = None,
) -> StatisticalVerdict:
    """Judge the coverage of intervals: how many of n hold the truth is binomial.

    Null hypothesis: each interval holds the truth with the probability `level`, independently; at_least: or with more
    (one-sided; for intervals that are wider by design). hits: (n) bool. tolerance: by how much the probability may
    differ from the level, for what is stated as approximate. independent: how many of the n are independent, where
    intervals share their data; None: all. n tell the probability to √(level (1 − level)/n).
    """
    hits = np.asarray(hits, bool).ravel()
    count = hits.size if independent is None else round(independent)
    held = float(hits.mean()) * count
    held = round(held) if abs(held - round(held)) < 1e-9 * count else held  # 0.9 · 30 is 27
    low, high = max(level - tolerance, 0.0), min(level + tolerance, 1.0)
    p_low, p_high = float(stats.binom.cdf(held, count, low)), float(stats.binom.sf(math.ceil(held) - 1, count, high))
    p = p_low if at_least else min(1.0, 2.0 * min(p_low, p_high))
    return StatisticalVerdict(p > significance, p, f"{hits.sum()} of {hits.size} hold, {level:.0%} stated, p {p:.2g}")


def alarms_are_rare(p_values: ArrayLike, level: float, significance: float = SIGNIFICANCE) -> StatisticalVerdict:
    """Judge a test of significance by how often it refuses what is true: a number of alarms that is binomial.

    Null hypothesis: each of the independent p-values falls below `level` with a probability of `level` at most.
    """
    p_values = np.asarray(p_values, float).ravel()
    alarms = int(np.sum(p_values < level))
    p = float(stats.binom.sf(alarms - 1, p_values.size, level))
    return StatisticalVerdict(p > significance, p, f"{alarms} of {p_values.size} below {level:g}, p {p:.2g}")


def converges_with_order(
    steps: ArrayLike, errors: ArrayLike, order: float, tolerance: float = 0.5
) -> StatisticalVerdict:
    """Judge a solver by log(error ratio)/log(step ratio) between each two neighbouring steps, all ≥ order − tolerance.

    No draws, so no significance (the p-value is 1 or 0): errors against the limit or a far finer solution must be above
    rounding. The tolerance allows for terms of higher order at coarse steps; half an order tells 1 from 2.
    """
    steps, errors = np.asarray(steps, float), np.asarray(errors, float)
    orders = np.diff(np.log(errors)) / np.diff(np.log(steps))
    stands = bool((orders >= order - tolerance).all())
    return StatisticalVerdict(stands, float(stands), f"orders {np.array2string(orders, precision=2)}, stated {order:g}")


def _block_means(values: NDArray[np.float64], block: int) -> NDArray[np.float64]:
    """Means over blocks of `block` × `block` pixels; those at the right and lower border may be smaller."""
    return _block_sums(values, block) / _block_sizes(values.shape, block)


def _block_sums(values: Any, block: int) -> NDArray[np.float64]:
    rows, columns = (np.arange(0, size, block) for size in values.shape[:2])
    return np.add.reduceat(np.add.reduceat(values, rows, axis=0), columns, axis=1)


def _block_sizes(shape: tuple[int, ...], block: int) -> NDArray[np.float64]:
    return _block_sums(np.ones((*shape[:2], *[1] * (len(shape) - 2))), block)
