"""Noise of a sensor: the variance of a linear signal by its gain and its read noise, and where these are from.

Photon transfer: gain and read noise of a sensor from the variance of its signals, over all frames together.

The variance of a linear signal S [DN] is S/g + (r/g)² + rounding, with the gain g [e⁻/DN] and the read noise r [e⁻]
(Janesick 2007, "Photon Transfer"). Enters: rows, each the variance of a bin of samples of one signal. Leaves: `Noise`.
What frames do not say, sensors in general do: ln g and ln (r/g)² have a wide prior. Scene that is left in the
differences of a pair only adds to the variance, with the square of the gradient; it is fitted for each pair, and the
smoothest samples judge whether that did.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.least_squares.loss import NORMAL_MEDIAN, log_interval

KNOWN_GAIN = 0.3  # relative error of the gain below which the frames are said to determine it
PRIOR_SPREAD = np.array([1.5, 3.0])  # of ln g and ln (r/g)² about those of a usual sensor: factors of 4.5
ROUNDING_ERROR = 0.03  # relative, of the variance of rounding
OUTLYING = 2.0  # [standard deviations] rows beyond count linearly (Huber)
PARTS = 4  # of a bin of samples, by the gradient of the scene; the first is the smoothest
DISAGREES = 2.0  # standard errors of the smoothest part from which the others are scene
MODEL_ERROR = 0.01  # relative, of the gain: scene, rounding and cut-off noise are removed approximately
ROUNDS = 8  # reweightings
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Noise:
    """gain [e⁻/DN] and read_noise [e⁻] with standard errors (0 if the user stated them); source: their origin."""

    gain: float
    read_noise: float
    gain_error: float = 0.0
    read_error: float = 0.0
    source: str = "stated"

    def __post_init__(self) -> None:
        """Check the figures once."""
        if not (np.isfinite(self.gain) and self.gain > 0.0 and np.isfinite(self.read_noise) and self.read_noise >= 0.0):
            raise InputError(
                f"gain {self.gain} e⁻/DN and read noise {self.read_noise} e⁻: the gain must be above 0, "
                "the read noise 0 or more"
            )

    @property
    def gain_interval(self) -> tuple[float, float]:
        """95 % interval of the gain [e⁻/DN]."""
        return log_interval(self.gain, self.gain_error / self.gain)

    @property
    def determined(self) -> bool:
        """Whether the gain was stated, or frames determine it."""
        return self.gain_error <= KNOWN_GAIN * self.gain

    def variance(self, signal: NDArray, rounding: NDArray | float) -> NDArray[np.float64]:
        """Variance [DN²] of a signal with expectation `signal` [DN]; one electron² is added, so that it is never 0."""
        return (np.maximum(signal, 0.0) + (1.0 + self.read_noise**2) / self.gain) / self.gain + rounding


class NoiseBin(NamedTuple):
    """A bin of samples whose variance [DN²] is shot/g + floors (r/g)² + rounding, and what the scene adds.

    shot [DN]. floors: 1 of a frame, 1 + 1/r² of the difference a − b/r of two. rounding [DN²]. count: of independent
    samples. roughness: mean squared gradient [DN²]. pair: number of the pair of frames, each of which has scene of its
    own. part: of the bin, 0 the smoothest.
    """

    shot: float
    floors: float
    variance: float
    rounding: float
    count: float
    roughness: float = 0.0
    pair: int = 0
    part: int = 0


class _NoiseFit(NamedTuple):
    """ln g and ln (r/g)², and their covariance."""

    log: Array
    covariance: Array

    @property
    def error(self) -> float:
        """Standard error of ln g."""
        return float(np.sqrt(self.covariance[0, 0]))


def noise_of_rows(rows: Sequence[NoiseBin], usual: Noise, source: str) -> Noise:
    """Gain and read noise by all `rows`, or by those of smoother samples where the others hold scene.

    usual: what a sensor of this kind has, if nothing is known of it. `InputError` for fewer than two rows.
    """
    if len(rows) < 2:
        raise InputError(
            "the frames have too few unclipped pixels to estimate their noise: state gain and read_noise (--gain, "
            "--read-noise)"
        )
    found = _without_scene(rows, usual)
    gain, deviation = float(np.exp(found.log[0])), float(np.exp(0.5 * found.log[1]))
    of_read = np.array([1.0, 0.5])  # ln r = ln g + ½ ln (r/g)²
    read_error = gain * deviation * float(np.sqrt(of_read @ found.covariance @ of_read))
    return Noise(gain, gain * deviation, gain * float(np.hypot(found.error, MODEL_ERROR)), read_error, source)


def _without_scene(rows: Sequence[NoiseBin], usual: Noise) -> _NoiseFit:
    """The fit of as many parts of the bins as agree with the smoothest, which are as many as determine the gain."""
    found, judges = _fit(rows, usual), (1, 2) if any(row.part for row in rows) else ()
    for least in judges:
        smoothest = _fit([row for row in rows if row.part < least], usual)
        if smoothest.error < KNOWN_GAIN:
            break
    else:
        return found
    count = PARTS
    while count > least and abs(found.log[0] - smoothest.log[0]) > DISAGREES * smoothest.error:
        count //= 2
        found = _fit([row for row in rows if row.part < count], usual)
    return found


def _fit(rows: Sequence[NoiseBin], usual: Noise) -> _NoiseFit:
    from scipy.optimize import least_squares

    shot, floors, variance, rounding, count, roughness, pair = np.array([row[:7] for row in rows], np.float64).T
    pair = np.unique(pair, return_inverse=True)[1]
    prior = np.array([np.log(usual.gain), 2.0 * np.log(max(usual.read_noise, 1e-3) / usual.gain)])

    def model(log: Array, spread: Array) -> Array:
        """The variance, with as much of the scene of each pair as it is still lacking."""
        plain = np.exp(-log[0]) * shot + np.exp(log[1]) * floors + rounding
        weight = roughness / spread**2
        power = np.bincount(pair, weight * roughness)
        scene = np.bincount(pair, weight * (variance - plain)) / np.maximum(power, 1e-300)
        return plain + np.maximum(scene, 0.0)[pair] * roughness

    def spread_of(expected: Array, misfit: float) -> Array:
        unsure = np.hypot(_rounding_unsure(log, shot, floors, rounding), ROUNDING_ERROR * rounding)
        return np.sqrt(misfit * 2.0 * expected**2 / count + unsure**2)

    log, misfit, expected, slopes = prior, 1.0, np.maximum(variance, np.maximum(rounding, 1e-12)), np.eye(2)
    for _ in range(ROUNDS):  # the weights follow the model, not the noise of each bin
        spread = spread_of(expected, misfit)
        solved = least_squares(
            lambda at, spread=spread: np.r_[(variance - model(at, spread)) / spread, (at - prior) / PRIOR_SPREAD],
            log,
            loss="huber",
            f_scale=OUTLYING,
        )
        log, slopes, expected = solved.x, solved.jac, np.maximum(model(solved.x, spread), 1e-12)
        off = (variance - expected) / spread_of(expected, 1.0)
        freedom = len(rows) / max(len(rows) - 2 - int(pair.max(initial=0)) * bool(roughness.any()), 1)
        misfit = max(float(np.median(off**2)) / NORMAL_MEDIAN * freedom, 1.0)
    return _NoiseFit(log, np.asarray(np.linalg.inv(slopes.T @ slopes), np.float64))


def _rounding_unsure(log: Array, shot: Array, floors: Array, rounding: Array) -> Array:
    """By how much rounding may differ from that of signals which are spread evenly between whole numbers [DN²].

    It is a wave over the fraction of the signal, which noise evens out (Widrow 1961). Signals of different fraction do
    not: bins by level and by gradient select samples by their fraction where noise is small. So it is the same in all
    rows, and counts as much as if there were one.
    """
    step = np.maximum(12.0 * rounding / floors, 1e-12)  # squared
    longer = np.sqrt(np.maximum(floors - 1.0, 0.0))  # 1/r
    noise = (np.exp(-log[0]) * shot / (1.0 + longer) + np.exp(log[1])) / step
    wave = np.exp(-2.0 * np.pi**2 * noise) * (np.pi**-2 + 4.0 * noise) / np.sqrt(2.0)
    return step * wave * np.hypot(1.0, longer**2) * np.sqrt(len(shot))
