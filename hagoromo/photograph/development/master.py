"""Master frames: mean dark signal and hot samples from dark frames; relative illumination from flat-field frames."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.least_squares.loss import robust_scale
from hagoromo.photograph.development.exposure import Exposure, alike, planes
from hagoromo.photograph.development.noise import Noise

HOT_SIGNIFICANCE = 8.0  # a sample is hot beyond so many robust standard deviations above the median of its colour
SAME_TIME = 1.1  # largest factor between the exposure times of a photograph and its dark frames
LEAST_SHARE = 0.2  # least relative illumination of a usable sample of a flat field


class Dark(NamedTuple):
    """Dark signal [DN], the variance of its mean [DN²], and hot samples; all of the shape of a frame."""

    signal: NDArray[np.float32]
    variance: NDArray[np.float32]
    hot: NDArray[np.bool_]


class Flat(NamedTuple):
    """Illumination of every sample relative to the mean of its colour, its variance, and where it is usable."""

    share: NDArray[np.float32]
    variance: NDArray[np.float32]
    usable: NDArray[np.bool_]


def dark_master(frames: Sequence[Exposure], seconds: float, noise: Noise) -> Dark:
    """The mean of the dark frames whose exposure time is closest to `seconds`, that of the photograph."""
    alike(frames, "dark frames")
    places = nearest_times([frame.seconds for frame in frames], seconds, [frame.name for frame in frames])
    chosen = [frames[place] for place in places]
    return dark_of(np.mean([frame.signal for frame in chosen], axis=0), len(chosen), chosen[0], noise)


def nearest_times(times: Sequence[float], seconds: float, names: Sequence[str]) -> list[int]:
    """Places of the dark frames whose time [s] is closest to `seconds`; a warning where that is another time."""
    off = [abs(np.log(time / seconds)) for time in times]
    chosen = [place for place, far in enumerate(off) if far <= min(off) + np.log(SAME_TIME)]
    if min(off) > np.log(SAME_TIME):
        warnings.warn(
            f"no dark frame has the exposure time {seconds:g} s: {names[chosen[0]]} ({times[chosen[0]]:g} s) is used",
            stacklevel=3,
        )
    return chosen


def dark_of(signal: NDArray, count: int, frame: Exposure, noise: Noise) -> Dark:
    """The dark frame of the mean `signal` of `count` frames that are like `frame`."""
    variance = noise.variance(signal, frame.rounding) / count
    hot = np.zeros(signal.shape, np.bool_)
    for values, marked in zip(planes(signal, frame.mosaic), planes(hot, frame.mosaic), strict=True):
        above = values - np.median(values)
        marked[:] = above > HOT_SIGNIFICANCE * max(robust_scale(above), np.sqrt(float(np.median(variance))))
    return Dark(signal.astype(np.float32), variance.astype(np.float32), hot)


def flat_master(frames: Sequence[Exposure], darks: Sequence[Exposure], noise: Noise) -> Flat:
    """The mean of flat-field frames (an evenly lit white field) minus dark frames, if any; normalised per colour."""
    alike(frames, "flat fields")
    dark = dark_master(darks, frames[0].seconds, noise).signal if darks else np.float32(0.0)
    signal = np.mean([frame.signal for frame in frames], axis=0) - dark
    full = np.any([frame.full for frame in frames], axis=0)
    return flat_of(signal, len(frames), full, frames[0], noise, frames[0].name)


def flat_of(signal: NDArray, count: int, full: NDArray[np.bool_], frame: Exposure, noise: Noise, name: str) -> Flat:
    """The flat field of the mean `signal` of `count` frames that are like `frame`, less dark; full: where clipped."""
    variance = noise.variance(signal, frame.rounding) / count
    usable = ~full
    share, spread = np.ones_like(signal), np.zeros_like(variance)
    for parts in zip(*(planes(a, frame.mosaic) for a in (signal, variance, usable, share, spread)), strict=True):
        light, noisy, fine, out, error = parts
        level = float(light[fine].mean()) if fine.any() else 0.0
        if level <= 0.0:
            raise InputError(f"the flat field {name} is clipped or dark: expose it to half of white")
        out[:], error[:] = light / level, noisy / level**2
    usable &= share > LEAST_SHARE
    return Flat(share.astype(np.float32), np.asarray(spread, np.float32), usable)


def odd_samples(signal: NDArray, variance: NDArray, valid: NDArray[np.bool_], mosaic: str) -> NDArray[np.bool_]:
    """Isolated bright samples: hot samples that are detected without dark frames.

    They exceed four times the brightest neighbour of the same colour, and exceed it by ten standard deviations; the
    image of a point light covers more samples than one.
    """
    from scipy.ndimage import maximum_filter

    around = np.array([[1, 1, 1], [1, 0, 1], [1, 1, 1]], np.bool_)
    odd = np.zeros(signal.shape, np.bool_)
    for values, spread, fine, out in zip(*(planes(a, mosaic) for a in (signal, variance, valid, odd)), strict=True):
        brightest = maximum_filter(np.where(fine, values, np.inf), footprint=around, mode="nearest")
        out[:] = fine & (values > 4.0 * brightest) & (values - brightest > 10.0 * np.sqrt(spread))
    return odd
