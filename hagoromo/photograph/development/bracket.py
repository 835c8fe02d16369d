"""Bracket: several exposures of one scene are merged, each sample weighted by its variance.

Whether a sample is used depends on the shorter exposures, never on its own noise. So the result is unbiased, and its
variance is the stated one.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.photograph.development.exposure import planes
from hagoromo.photograph.development.noise import Noise

CEILING = 0.9  # share of white; samples predicted to be brighter are not used, because noise may clip them


class BracketExposure(NamedTuple):
    """One exposure of a bracket after subtraction of its dark frame.

    signal, dark: (height, width[, channels]) [DN]; dark is a number if there is no dark frame. dark_variance: of `dark`
    [DN²]. rounding: variance of quantisation [DN²]. full: where the signal is clipped. white [DN]. seconds: exposure
    time, in one unit for all exposures. curve: variance by an estimated transfer curve [DN²]; this error is common to
    samples and exposures.
    """

    signal: NDArray[np.float32]
    dark: NDArray[np.float32] | float
    dark_variance: NDArray[np.float32] | float
    rounding: NDArray[np.float32] | float
    full: NDArray[np.bool_]
    white: float
    seconds: float
    curve: NDArray[np.float32] | float = 0.0

    def variance(self, rate: NDArray, noise: Noise) -> NDArray[np.float64]:
        """Variance [DN²] of the signal of a scene of `rate` [DN/s], without that of the transfer curve."""
        expected = np.maximum(rate, 0.0) * self.seconds + np.maximum(self.dark, 0.0)
        return noise.variance(expected, self.rounding) + self.dark_variance


class Merged(NamedTuple):
    """rate [DN/s]; its variance [(DN/s)²]; valid: true where at least one exposure was not clipped."""

    rate: NDArray[np.float32]
    variance: NDArray[np.float32]
    valid: NDArray[np.bool_]


def merge(shots: Sequence[BracketExposure], noise: Noise, mosaic: str) -> Merged:
    """Maximum-likelihood merge of the exposures (for nearly normal noise), with weights seconds²/variance.

    The variance is that of the expected signal: the total signal over the total time, averaged over neighbours of the
    same colour. So a weight is not correlated with the noise of the sample that it weights.
    """
    shots = sorted(shots, key=lambda shot: shot.seconds)
    uses, total, seconds = [], np.zeros(shots[0].signal.shape), np.zeros(shots[0].signal.shape)
    for shot in shots:
        predicted = shot.seconds * total / np.maximum(seconds, 1e-30)
        uses.append(~shot.full & (predicted < CEILING * shot.white))
        total += uses[-1] * shot.signal
        seconds += uses[-1] * shot.seconds
    valid = seconds > 0.0
    expected = _smoothed(total, seconds, mosaic)
    spread = [shot.variance(expected, noise) + shot.curve for shot in shots]
    weights = [use * shot.seconds**2 / spread_of for use, shot, spread_of in zip(uses, shots, spread, strict=True)]
    whole = np.where(valid, sum(weights), 1.0)
    rate = sum(w * shot.signal / shot.seconds for w, shot in zip(weights, shots, strict=True)) / whole
    variance = sum(w**2 * shot.variance(rate, noise) / shot.seconds**2 for w, shot in zip(weights, shots, strict=True))
    common = sum(w * np.sqrt(shot.curve) / shot.seconds for w, shot in zip(weights, shots, strict=True))
    variance = variance + common**2
    return Merged(rate.astype(np.float32), np.asarray(variance / whole**2, np.float32), np.asarray(valid, np.bool_))


def _smoothed(total: NDArray, seconds: NDArray, mosaic: str) -> NDArray[np.float64]:
    """Mean rate [DN/s] of a sample and its eight neighbours of the same colour."""
    from scipy.ndimage import uniform_filter

    rate = np.empty_like(total)
    for out, signal, time in zip(*(planes(a, mosaic) for a in (rate, total, seconds)), strict=True):
        out[:] = uniform_filter(signal, 3, mode="nearest") / np.maximum(uniform_filter(time, 3, mode="nearest"), 1e-30)
    return rate
