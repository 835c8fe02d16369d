"""Bracket: several exposures of one scene are merged, each sample weighted by its variance.

Whether a sample is used depends on the shorter exposures, never on its own noise. So the result is unbiased, and its
variance is the stated one.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.least_squares.loss import robust_scale
from hagoromo.photograph.development.exposure import planes
from hagoromo.photograph.development.noise import Noise

CEILING = 0.9  # share of white; samples predicted to be brighter are not used, because noise may clip them
SHIFT_STEPS_PER_PIXEL = 20  # resolution of an estimated shift
SHIFT_PASSES = 2  # in the second, the window shows the same part of the scene in both pictures
SHARE_LEFT = 0.9  # a shift is accepted if it reduces the squared difference below this share
LEAST_SCENE_SHARE = 0.5  # of the variance of both pictures that must be the scene: the rest is noise
LEAST_CORRELATION = 0.5  # of the pictures after the shift, relative to the one that their noise allows
CERTAIN_SHIFT = 6.0  # standard errors (of Fisher's z) by which the shift must raise the correlation
BORDER_PX = 4  # [px] border that is ignored, because a shifted picture lacks it
SMOOTHED_PX = 1.0  # [px] standard deviation of the smoothing
SMOOTHED_NOISE = 1.0 / (4.0 * np.pi * SMOOTHED_PX**2)  # share of the variance of white noise that the smoothing leaves
Array = NDArray[np.float64]


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


def shift_between(one: BracketExposure, other: BracketExposure, noise: Noise, mosaic: str) -> tuple[float, float]:
    """Shift (x, y) [px] of the image of `other` relative to that of `one`; (0, 0) if none is significant.

    Both are limited to the brightest light that neither has clipped, and scaled to uniform noise. A picture that is
    nearly black, or all clipped, shows no scene, so nothing is said of its shift.
    """
    from scipy.ndimage import gaussian_filter, shift
    from skimage.registration import phase_cross_correlation

    ceiling = CEILING * min(one.white / one.seconds, other.white / other.seconds)
    floor = (3.0 / 8.0 + noise.read_noise**2) / min(one.seconds, other.seconds)
    pictures = [_grey(shot, ceiling, noise.gain, floor, mosaic) for shot in (one, other)]
    first, second = (gaussian_filter(picture, SMOOTHED_PX) for picture in pictures)  # interpolation smooths no further
    shares = [_scene_share(*pair) for pair in zip(pictures, (first, second), strict=True)]
    if min(shares) < LEAST_SCENE_SHARE:
        return 0.0, 0.0
    window = np.outer(*(np.hanning(n + 2)[1:-1] for n in first.shape))
    rows, columns, back = 0.0, 0.0, second
    for _ in range(SHIFT_PASSES):
        pair = [(picture - picture.mean()) * window for picture in (first, back)]
        step = phase_cross_correlation(*pair, upsample_factor=SHIFT_STEPS_PER_PIXEL, normalization=None)[0]  # type: ignore[arg-type]
        rows, columns = rows + float(step[0]), columns + float(step[1])
        back = shift(second, (rows, columns), order=3, mode="nearest")
    if not _improves(first, second, back, float(np.sqrt(shares[0] * shares[1]))):
        return 0.0, 0.0
    wide = 2.0 if mosaic else 1.0  # pixels of the sensor per pixel of the grey picture
    return -wide * columns, -wide * rows


def _improves(first: Array, second: Array, back: Array, allowed: float) -> bool:
    """Whether `back`, which is `second` after the shift, matches `first` better by more than chance.

    allowed: correlation that the noise of both allows.
    """
    inner = slice(BORDER_PX, -BORDER_PX)
    if min(float(np.ptp(picture[inner, inner])) for picture in (first, second, back)) == 0.0:
        return False
    before, after = (((first - picture)[inner, inner] ** 2).mean() for picture in (second, back))
    still, shifted = (
        float(np.corrcoef(first[inner, inner].ravel(), picture[inner, inner].ravel())[0, 1])
        for picture in (second, back)
    )
    independent = first[inner, inner].size * SMOOTHED_NOISE
    gain = (np.arctanh(min(shifted, 1.0 - 1e-9)) - np.arctanh(min(still, 1.0 - 1e-9))) * np.sqrt(independent)
    return bool(after < SHARE_LEFT * before and shifted > LEAST_CORRELATION * allowed and gain > CERTAIN_SHIFT)


def _scene_share(picture: Array, smoothed: Array) -> float:
    """Share of the variance of the `smoothed` picture that is not white noise, which differences in `picture` show."""
    from scipy.ndimage import convolve1d

    total, bend = float(smoothed.var()), np.array([1.0, -2.0, 1.0]) / np.sqrt(6.0)
    noise = robust_scale(convolve1d(convolve1d(picture, bend, 0), bend, 1)) ** 2  # Immerkær 1996: texture adds to it
    return 1.0 - noise * SMOOTHED_NOISE / total if total > 0.0 else 0.0


def _grey(shot: BracketExposure, ceiling: float, gain: float, floor: float, mosaic: str) -> Array:
    """Mean of the colours as the square root of electrons per second, which has uniform noise (Anscombe 1948)."""
    rate = np.where(shot.full, ceiling, np.clip(shot.signal / shot.seconds, 0.0, ceiling))
    colours = planes(rate, mosaic)
    rows, columns = (min(colour.shape[axis] for colour in colours) for axis in (0, 1))
    mean = np.mean([colour[:rows, :columns] for colour in colours], axis=0)
    return np.sqrt(mean * gain + floor)
