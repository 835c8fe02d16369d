"""Movement: did camera or scene move between two exposures? By phase correlation (scikit-image)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hagoromo.photograph.development.bracket import CEILING, Shot
from hagoromo.photograph.development.exposure import planes
from hagoromo.photograph.development.noise import Noise

SHIFT_STEPS_PER_PIXEL = 20  # of a pixel that a shift is told to
SHIFT_PASSES = 2  # the second sees the same part of the scene through the window as the first picture
SHARE_LEFT = 0.9  # a shift is one if it leaves less than this share of the squared difference
BORDER_PX = 4  # pixels beside the border that a shifted picture lacks


def shift_between(one: Shot, other: Shot, noise: Noise, mosaic: str) -> tuple[float, float]:
    """How far the content of `other` stands from that of `one`: (x, y) [px], (0, 0) where no shift explains more.

    Both are cut at the brightest light that neither has clipped, and weighted by their noise.
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
    """Mean of the colours, as the square root of electrons a second: of one noise everywhere (Anscombe 1948).

    Smoothed by a pixel, so that what interpolates it later takes no more noise away.
    """
    from scipy.ndimage import gaussian_filter

    rate = np.where(shot.full, ceiling, np.clip(shot.signal / shot.seconds, 0.0, ceiling))
    colours = planes(rate, mosaic)
    rows, columns = (min(colour.shape[axis] for colour in colours) for axis in (0, 1))
    mean = np.mean([colour[:rows, :columns] for colour in colours], axis=0)
    return np.asarray(gaussian_filter(np.sqrt(mean * gain + floor), 1.0))
