"""Movement: shift of the image between two exposures, by phase correlation (scikit-image)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hagoromo.photograph.development.bracket import CEILING, Shot
from hagoromo.photograph.development.exposure import planes
from hagoromo.photograph.development.noise import Noise

SHIFT_STEPS_PER_PIXEL = 20  # resolution of an estimated shift
SHIFT_PASSES = 2  # in the second, the window shows the same part of the scene in both pictures
SHARE_LEFT = 0.9  # a shift is accepted if it reduces the squared difference below this share
BORDER_PX = 4  # [px] border that is ignored, because a shifted picture lacks it


def shift_between(one: Shot, other: Shot, noise: Noise, mosaic: str) -> tuple[float, float]:
    """Shift (x, y) [px] of the image of `other` relative to that of `one`; (0, 0) if no shift improves the match.

    Both are limited to the brightest light that neither has clipped, and scaled to uniform noise.
    """
    from scipy.ndimage import shift
    from skimage.registration import phase_cross_correlation

    ceiling = CEILING * min(one.white / one.seconds, other.white / other.seconds)
    floor = (3.0 / 8.0 + noise.read_noise**2) / min(one.seconds, other.seconds)
    first, second = (_grey(shot, ceiling, noise.gain, floor, mosaic) for shot in (one, other))
    window = np.outer(*(np.hanning(n + 2)[1:-1] for n in first.shape))
    rows, columns, back = 0.0, 0.0, second
    for _ in range(SHIFT_PASSES):
        pair = [(picture - picture.mean()) * window for picture in (first, back)]
        step = phase_cross_correlation(*pair, upsample_factor=SHIFT_STEPS_PER_PIXEL, normalization=None)[0]  # type: ignore[arg-type]
        rows, columns = rows + float(step[0]), columns + float(step[1])
        back = shift(second, (rows, columns), order=3, mode="nearest")
    inner = slice(BORDER_PX, -BORDER_PX)
    before, after = (((first - picture)[inner, inner] ** 2).mean() for picture in (second, back))
    if not after < SHARE_LEFT * before:
        return 0.0, 0.0
    wide = 2.0 if mosaic else 1.0  # pixels of the sensor per pixel of the grey picture
    return -wide * columns, -wide * rows


def _grey(shot: Shot, ceiling: float, gain: float, floor: float, mosaic: str) -> NDArray[np.float64]:
    """Mean of the colours as the square root of electrons per second, which has uniform noise (Anscombe 1948).

    Smoothed by one pixel, so that later interpolation does not reduce the noise further.
    """
    from scipy.ndimage import gaussian_filter

    rate = np.where(shot.full, ceiling, np.clip(shot.signal / shot.seconds, 0.0, ceiling))
    colours = planes(rate, mosaic)
    rows, columns = (min(colour.shape[axis] for colour in colours) for axis in (0, 1))
    mean = np.mean([colour[:rows, :columns] for colour in colours], axis=0)
    return np.asarray(gaussian_filter(np.sqrt(mean * gain + floor), 1.0))
