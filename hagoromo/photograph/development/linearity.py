"""Linearity: test that the signal is proportional to the exposure, measure ratios of exposure times and a common black.

Each colour of the mosaic is tested by itself: under lamps of narrow bands its samples differ in signal, and so in what
clipped neighbours and an offset do to them. The ratios are needed because shutters are accurate to a few percent only,
the common black because cameras subtract up to 1 DN too much.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.photograph.development.bracket import CEILING, BracketExposure
from hagoromo.photograph.development.exposure import planes
from hagoromo.photograph.development.noise import Noise

SHUTTER_TOLERANCE = 0.12  # largest relative error of a stated time: "1/60" is 1/64 s, plus a few percent
CONTRADICTED = 4.0  # standard errors by which a measured ratio must differ to replace the stated one, or a black from 0
LARGEST_BEND = 0.03  # largest relative change of the ratio of two exposures from dark to bright samples
CERTAIN_BEND = 5.0  # standard errors from which such a change is significant
FAINT_SIGNAL = 0.05  # least signal of the longer exposure, as a share of white, of samples that are compared
BLACK_SIGNAL = 0.001  # the same of samples that determine the common black, which matters most in the dark
BLACK_RANGE = (-0.2, 1.0)  # [DN] common black: cameras over-subtract by up to 1 DN; more is a wrong level, not this
SIGNAL_LEVELS = 5  # number of levels of the signal, of equally many samples
FEWEST_PER_LEVEL = 100  # least number of samples of a level
Array = NDArray[np.float64]


class Ratio(NamedTuple):
    """Ratio of the signals of two exposures; its standard error; bend: (largest − smallest)/mean over the levels."""

    signal: float
    error: float
    bend: float


class SignalLevels(NamedTuple):
    """One colour of two exposures, by levels of the signal: mean signals [DN] and the variances of these means."""

    low: Array
    high: Array
    low_variance: Array
    high_variance: Array

    def ratios(self) -> tuple[Array, Array]:
        """high/low at each level, and its standard error."""
        ratio = self.high / self.low
        return ratio, ratio * np.sqrt(self.high_variance / self.high**2 + self.low_variance / self.low**2)


def measured_seconds(
    shots: Sequence[BracketExposure], names: Sequence[str], noise: Noise, mosaic: str = ""
) -> tuple[list[float], list[Ratio]]:
    """Exposure times [s], the shortest as stated, and the ratios of signals of successive exposures.

    shots, names: from the shortest to the longest. A stated time is kept unless the signals contradict it, or if two
    exposures share too few samples. `InputError` if the response is not linear.
    """
    seconds, ratios = [shots[0].seconds], []
    for i in range(1, len(shots)):
        stated = shots[i].seconds / shots[i - 1].seconds
        ratio = _ratio(shots[i - 1], shots[i], noise, mosaic)
        if ratio is not None:
            _check(ratio, stated, names[i - 1], names[i])
            ratios.append(ratio)
        contradicted = ratio is not None and abs(ratio.signal - stated) > CONTRADICTED * ratio.error
        seconds.append(seconds[-1] * (ratio.signal if ratio is not None and contradicted else stated))
    return seconds, ratios


def common_black(shots: Sequence[BracketExposure], noise: Noise, mosaic: str) -> float:
    """Offset δ [DN] to add to all signals so that they are proportional: h + δ = r (l + δ) at every level.

    r is free for each colour of each pair of successive exposures; δ lies in `BLACK_RANGE`. 0 unless it differs from 0
    by `CONTRADICTED` standard errors, which include the misfit.
    """
    from scipy.optimize import minimize

    pairs = [of for one, other in pairwise(shots) for of in _levels(one, other, noise, mosaic, BLACK_SIGNAL)]
    if not pairs:
        return 0.0

    def misfit(black: float) -> float:
        return sum(_misfit(pair, black) for pair in pairs)

    best = float(minimize(lambda x: misfit(float(x[0])), [0.0], bounds=[BLACK_RANGE], method="Nelder-Mead").x[0])
    per_freedom = misfit(best) / max(sum(len(pair.low) - 1 for pair in pairs) - 1, 1)
    return best if misfit(0.0) - misfit(best) > CONTRADICTED**2 * max(per_freedom, 1.0) else 0.0


def _misfit(pair: SignalLevels, black: float) -> float:
    """χ² of the ratio of one pair, fitted, with `black` added to both signals."""
    low, high = pair.low + black, pair.high + black
    weight = 1.0 / (pair.high_variance + (high.sum() / low.sum()) ** 2 * pair.low_variance)
    ratio = (weight * high * low).sum() / (weight * low**2).sum()
    return float((weight * (high - ratio * low) ** 2).sum())


def _levels(
    short: BracketExposure, long: BracketExposure, noise: Noise, mosaic: str, faint: float
) -> list[SignalLevels]:
    """The levels of each colour that has enough samples above `faint` (a share of white) that neither has clipped."""
    stated = long.seconds / short.seconds
    # from the sum of both, so that samples are not selected or sorted by the noise of their ratio
    level = (short.signal + long.signal) * (stated / (1.0 + stated))
    usable = ~(short.full | long.full) & (level < CEILING * long.white) & (level > faint * long.white)
    curves = [np.sqrt(np.broadcast_to(np.float32(shot.curve), usable.shape)) for shot in (short, long)]
    spreads = [shot.variance(shot.signal / shot.seconds, noise) for shot in (short, long)]
    found = []
    for fine, bright, *parts in zip(
        *(planes(a, mosaic) for a in (usable, level, short.signal, long.signal, *spreads, *curves)), strict=True
    ):
        low, high, low_spread, high_spread, low_curve, high_curve = (part[fine].astype(np.float64) for part in parts)
        if low.size < SIGNAL_LEVELS * FEWEST_PER_LEVEL:
            continue
        sorted_parts = np.array_split(np.argsort(bright[fine]), SIGNAL_LEVELS)
        means = [np.array([of[part].mean() for part in sorted_parts]) for of in (low, high, low_curve, high_curve)]
        variances = [np.array([of[p].mean() / len(p) for p in sorted_parts]) for of in (low_spread, high_spread)]
        if means[0].min() > 0.0 and means[1].min() > 0.0:
            found.append(SignalLevels(means[0], means[1], variances[0] + means[2] ** 2, variances[1] + means[3] ** 2))
    return found


def _ratio(short: BracketExposure, long: BracketExposure, noise: Noise, mosaic: str) -> Ratio | None:
    """The mean ratio over levels and colours, and the largest significant bend of any colour; None without samples."""
    every = [pair.ratios() for pair in _levels(short, long, noise, mosaic, FAINT_SIGNAL)]
    if not every:
        return None
    ratios, errors = (np.concatenate(parts) for parts in zip(*every, strict=True))
    weight = 1.0 / errors**2
    mean = float((weight * ratios).sum() / weight.sum())
    return Ratio(mean, float(weight.sum() ** -0.5), max(_bend(*one) for one in every))


def _bend(ratios: Array, errors: Array) -> float:
    """(largest − smallest)/mean of the ratios of one colour; 0 unless it is certain."""
    certain = np.ptp(ratios) > CERTAIN_BEND * float(np.hypot(*errors[[ratios.argmin(), ratios.argmax()]]))
    return float(np.ptp(ratios) / ratios.mean()) if certain else 0.0


def _check(ratio: Ratio, stated: float, short: str, long: str) -> None:
    if stated > 1.0 + SHUTTER_TOLERANCE and abs(ratio.signal / stated - 1.0) > SHUTTER_TOLERANCE:
        power = np.log(max(ratio.signal, 1e-9)) / np.log(stated)
        raise InputError(
            f"the response is not linear, or the times are wrong: {long} is exposed {stated:.3g} times as long as "
            f"{short} and its signal is {ratio.signal:.3g} times as large (power {power:.2f}): state transfer "
            "(--transfer) or exposures_s (--exposures)"
        )
    if ratio.bend > LARGEST_BEND:
        raise InputError(
            f"the response is not linear: the signal of {long} over that of {short} changes by "
            f"{100 * ratio.bend:.1f} % from dark to bright: state transfer (--transfer), or the right black (--black)"
        )
