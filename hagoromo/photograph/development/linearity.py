"""Linearity: test that the signal is proportional to the exposure, and measure ratios of exposure times.

Each colour of the mosaic is tested by itself: under lamps of narrow bands its samples differ in signal, and so in what
clipped neighbours and an offset do to them. The ratios are needed because shutters are accurate to a few percent only.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.photograph.development.bracket import CEILING, BracketExposure
from hagoromo.photograph.development.exposure import planes
from hagoromo.photograph.development.frame_pairs import CUT_OFF, cut_share, neighbours
from hagoromo.photograph.development.noise import Noise

SHUTTER_TOLERANCE = 0.12  # largest relative error of a stated time: "1/60" is 1/64 s, plus a few percent
CONTRADICTED = 4.0  # standard errors by which a measured ratio must differ to replace the stated one
LARGEST_BEND = 0.03  # largest relative change of the ratio of two exposures from dark to bright samples
CERTAIN_BEND = 5.0  # standard errors from which such a change is significant
FAINT_SIGNAL = 0.05  # least signal of the longer exposure, as a share of white, of samples that are compared
LIT = 5.0  # least signal of a level that has light [standard errors]
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

    def lit(self) -> bool:
        """Whether every level has light in both, beyond noise."""
        sides = (self.low, self.low_variance), (self.high, self.high_variance)
        return all(bool((mean > LIT * np.sqrt(variance)).all()) for mean, variance in sides)

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


def levels_of(
    short: BracketExposure, long: BracketExposure, noise: Noise, mosaic: str, faint: float = -np.inf
) -> list[SignalLevels]:
    """The levels of each colour that has enough samples above `faint` (a share of white) that neither has clipped.

    Samples are chosen and sorted by their neighbours of the same colour: their own noise must not decide about them.
    Those so dark that noise is cut off at the least number are left out: their means are too large.
    """
    stated = long.seconds / short.seconds
    level = (short.signal + long.signal) * (stated / (1.0 + stated))
    usable = ~(short.full | long.full)
    curves = [np.sqrt(np.broadcast_to(np.float32(shot.curve), usable.shape)) for shot in (short, long)]
    spreads = [shot.variance(shot.signal / shot.seconds, noise) for shot in (short, long)]
    roundings = [np.broadcast_to(np.float32(shot.rounding), usable.shape) for shot in (short, long)]
    found = []
    for ok, own, *parts in zip(
        *(planes(a, mosaic) for a in (usable, level, short.signal, long.signal, *spreads, *curves, *roundings)),
        strict=True,
    ):
        around = neighbours(own.astype(np.float64))
        whole = [
            cut_share(neighbours(signal.astype(np.float64)), np.sqrt(spread), float(signal.min()), float(step.mean()))
            < CUT_OFF
            for signal, spread, step in zip(parts[:2], parts[2:4], parts[6:], strict=True)
        ]
        fine = ok & whole[0] & whole[1] & (around < CEILING * long.white) & (around > faint * long.white)
        if np.count_nonzero(fine) >= SIGNAL_LEVELS * FEWEST_PER_LEVEL:
            order = np.argsort(around[fine], kind="stable")
            found.append(_levels([part[fine].astype(np.float64) for part in parts], order))
    return found


def _levels(parts: Sequence[Array], order: NDArray[np.intp]) -> SignalLevels:
    """Levels of samples in this `order`; parts: low, high; their variances; errors by their curves; roundings."""
    levels = np.array_split(order, SIGNAL_LEVELS)
    means = [np.array([of[part].mean() for part in levels]) for of in parts]
    counts = np.array([len(part) for part in levels])
    variances = [
        spread / counts + curve**2 + _rounding_error(spread - rounding, rounding) ** 2
        for spread, curve, rounding in zip(means[2:4], means[4:6], means[6:], strict=True)
    ]
    return SignalLevels(means[0], means[1], variances[0], variances[1])


def _rounding_error(noise: Array, rounding: Array) -> Array:
    """By how much the mean of rounded samples may differ from that of samples: a wave over their fraction [DN].

    Noise (its variance [DN²]) evens it out (Widrow 1961).
    """
    return (
        np.sqrt(12.0 * rounding)
        * np.exp(-2.0 * np.pi**2 * noise / np.maximum(12.0 * rounding, 1e-30))
        / (np.pi * np.sqrt(2.0))
    )


def _ratio(short: BracketExposure, long: BracketExposure, noise: Noise, mosaic: str) -> Ratio | None:
    """The mean ratio over levels and colours, and the largest significant bend of any colour; None without samples."""
    levels = levels_of(short, long, noise, mosaic, FAINT_SIGNAL)
    every = [pair.ratios() for pair in levels if pair.lit()]
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
