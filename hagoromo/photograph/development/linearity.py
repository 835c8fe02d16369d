"""Linearity: test that the signal is proportional to the exposure, and measure ratios of exposure times.

The measured ratios are needed because shutters are accurate to a few percent only.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from hagoromo.errors import InputError
from hagoromo.photograph.development.bracket import CEILING, Shot
from hagoromo.photograph.development.noise import Noise

SHUTTER_TOLERANCE = 0.12  # largest relative error of a stated time: "1/60" is 1/64 s, plus a few percent
CONTRADICTED = 4.0  # standard errors by which a measured ratio must differ to replace the stated one
LARGEST_BEND = 0.03  # largest relative change of the ratio of two exposures from dark to bright samples
CERTAIN_BEND = 5.0  # standard errors from which such a change is significant
FAINT_SIGNAL = 0.05  # least signal of the longer exposure, as a share of white, of samples that are compared
SIGNAL_LEVELS = 5  # number of levels of the signal, of equally many samples
FEWEST_PER_LEVEL = 100  # least number of samples of a level


class Ratio(NamedTuple):
    """Ratio of the signals of two exposures; its standard error; bend: (largest − smallest)/mean over the levels."""

    signal: float
    error: float
    bend: float


def measured_seconds(shots: Sequence[Shot], names: Sequence[str], noise: Noise) -> tuple[list[float], list[Ratio]]:
    """Exposure times [s], the shortest as stated, and the ratios of signals of successive exposures.

    shots, names: from the shortest to the longest. A stated time is kept unless the signals contradict it, or if two
    exposures share too few samples. `InputError` if the response is not linear.
    """
    seconds, ratios = [shots[0].seconds], []
    for i in range(1, len(shots)):
        stated = shots[i].seconds / shots[i - 1].seconds
        ratio = _ratio(shots[i - 1], shots[i], noise)
        if ratio is not None:
            _check(ratio, stated, names[i - 1], names[i])
            ratios.append(ratio)
        contradicted = ratio is not None and abs(ratio.signal - stated) > CONTRADICTED * ratio.error
        seconds.append(seconds[-1] * (ratio.signal if ratio is not None and contradicted else stated))
    return seconds, ratios


def _ratio(short: Shot, long: Shot, noise: Noise) -> Ratio | None:
    stated = long.seconds / short.seconds
    # from the sum of both, so that samples are not selected or sorted by the noise of their ratio
    level = (short.signal + long.signal) * (stated / (1.0 + stated))
    usable = ~(short.full | long.full) & (level < CEILING * long.white) & (level > FAINT_SIGNAL * long.white)
    low, high = short.signal[usable].astype(np.float64), long.signal[usable].astype(np.float64)
    if low.size < SIGNAL_LEVELS * FEWEST_PER_LEVEL or low.sum() <= 0.0:
        return None
    curve_high, curve_low = (np.sqrt(np.broadcast_to(shot.curve, usable.shape)[usable]) for shot in (long, short))
    spread_high = long.variance(long.signal / long.seconds, noise)[usable]
    spread_low = short.variance(short.signal / short.seconds, noise)[usable]
    parts = np.array_split(np.argsort(level[usable]), SIGNAL_LEVELS)
    ratios = np.array([high[part].sum() / low[part].sum() for part in parts])
    shares = [
        (spread_high[p].sum() + curve_high[p].sum() ** 2) / high[p].sum() ** 2
        + (spread_low[p].sum() + curve_low[p].sum() ** 2) / low[p].sum() ** 2
        for p in parts
    ]
    errors = ratios * np.sqrt(shares)
    bend = float(np.ptp(ratios) / ratios.mean())
    certain = bool(np.ptp(ratios) > CERTAIN_BEND * float(np.hypot(*errors[[ratios.argmin(), ratios.argmax()]])))
    weight = 1.0 / errors**2
    mean = float((weight * ratios).sum() / weight.sum())
    return Ratio(mean, float(weight.sum() ** -0.5), bend if certain else 0.0)


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
