"""Movement: shift of the image between two exposures, by phase correlation (scikit-image)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hagoromo.least_squares.loss import robust_scale
from hagoromo.photograph.development.bracket import CEILING, BracketExposure
from hagoromo.photograph.development.exposure import planes
from hagoromo.photograph.development.noise import Noise

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
