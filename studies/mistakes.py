"""Mistakes in photographs of one view, made on purpose: what the checks of a capture should name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

import hagoromo as hg

Change = Callable[[hg.Photograph], hg.Photograph]
DARKEST = 0.02  # of the largest value, below which errors grow no further with the slope of a curve
FLATTEST = 0.3  # slope of sRGB's curve near white, where a difference ends at white
ROUNDING = 1e-3  # error of values of 8 bits, of white


def under(capture: hg.Capture, order: ArrayLike) -> hg.Capture:
    """The capture whose k-th photograph is said to be lit by lamp order[k]."""
    lamps, places = [shot.lamps for shot in capture.photographs], np.asarray(order).tolist()
    return _each(capture, lambda k, shot: replace(shot, lamps=lamps[places[k]]))


def exchanged(capture: hg.Capture, a: int = 2, b: int = 5) -> hg.Capture:
    """Two photographs with one another's lamps."""
    order = np.arange(len(capture.photographs))
    order[[a, b]] = b, a
    return under(capture, order)


def turned(
    capture: hg.Capture, number: int = 3, degrees: float = 5.0, seed: int = 0
) -> tuple[hg.Capture, NDArray[np.float64]]:
    """One lamp that is stated some degrees off, as seen from the world's origin, and where it is."""
    (lamp,) = capture.photographs[number].lamps
    across = np.cross(lamp.place, np.random.default_rng(seed).standard_normal(3))
    across /= np.linalg.norm(across)
    angle = np.radians(degrees)
    stated = np.cos(angle) * lamp.place + np.sin(angle) * np.cross(across, lamp.place)
    moved_lamp = replace(lamp, **{lamp.place_key: stated})
    return with_shot(capture, number, lambda shot: replace(shot, lamps=(moved_lamp,))), lamp.place


def uneven(capture: hg.Capture, spread: float = 0.4, seed: int = 1) -> hg.Capture:
    """Lamps of different strengths, which nobody states."""
    factor = np.exp(spread * np.random.default_rng(seed).standard_normal(len(capture.photographs)))
    return _each(capture, lambda k, shot: brighter(shot, float(factor[k])))


def brighter(shot: hg.Photograph, factor: float) -> hg.Photograph:
    """A photograph under a lamp that is so many times as strong as stated."""
    return replace(shot, values=shot.values * factor, variance=shot.variance * factor**2)


def coded(capture: hg.Capture, power: float = 1.0 / 2.2) -> hg.Capture:
    """Values that follow light to a power, with their errors."""
    top = max(float(np.nanmax(shot.values)) for shot in capture.photographs)

    def curve(_: int, shot: hg.Photograph) -> hg.Photograph:
        share = np.maximum(shot.values / top, 0.0)
        slope = power * np.maximum(share, DARKEST) ** (power - 1.0)
        values, variance = top * share**power, shot.variance * slope**2
        return replace(shot, values=values.astype(np.float32), variance=variance.astype(np.float32))

    return _each(capture, curve)


def displayed(capture: hg.Capture) -> hg.Capture:
    """Values as a screen takes them (sRGB), of the largest as white, with their errors: by differences of DARKEST."""
    top = max(float(np.nanmax(shot.values)) for shot in capture.photographs)

    def sent(share: NDArray[Any]) -> NDArray[np.float32]:
        return hg.srgb_encode(np.clip(share, 0.0, 1.0)).astype(np.float32) / 255.0

    def curve(_: int, shot: hg.Photograph) -> hg.Photograph:
        share = np.clip(shot.values / top, 0.0, 1.0)
        values = sent(share)
        slope = np.maximum((sent(share + DARKEST) - values) / DARKEST, FLATTEST)
        return replace(shot, values=values, variance=shot.variance / top**2 * slope**2 + ROUNDING**2)

    return _each(capture, curve)


def twice(capture: hg.Capture, number: int = 4, of: int = 3) -> hg.Capture:
    """A photograph in place of another."""
    same = capture.photographs[of]
    return with_shot(capture, number, lambda shot: replace(same, lamps=shot.lamps, name=shot.name))


def moved(capture: hg.Capture, number: int = 4, across: float = 0.5, down: float = 0.0) -> hg.Capture:
    """A photograph that is shifted [px]."""
    by = down, across, 0
    return with_shot(capture, number, lambda s: replace(s, values=ndimage.shift(s.values, by, mode="nearest")))


def blurred(capture: hg.Capture, number: int = 4, width: float = 2.0) -> hg.Capture:
    """A photograph that is out of focus, by a Gaussian [px]."""
    by = width, width, 0
    return with_shot(capture, number, lambda s: replace(s, values=ndimage.gaussian_filter(s.values, by)))


def masked(capture: hg.Capture, by: int = 5) -> hg.Capture:
    """A mask that is so many pixels too large (below 0: too small)."""
    own = np.mean([shot.mask for shot in capture.photographs], axis=0) > 0.5
    own = np.asarray(ndimage.binary_fill_holes(own))
    other: Any = ndimage.binary_dilation(own, iterations=by) if by > 0 else ndimage.binary_erosion(own, iterations=-by)
    return _each(capture, lambda k, shot: replace(shot, mask=np.asarray(other)))


def with_shot(capture: hg.Capture, number: int, change: Change) -> hg.Capture:
    """The capture with one photograph changed."""
    return _each(capture, lambda k, shot: change(shot) if k == number else shot)


def _each(capture: hg.Capture, change: Callable[[int, hg.Photograph], hg.Photograph]) -> hg.Capture:
    return replace(capture, photographs=tuple(change(k, shot) for k, shot in enumerate(capture.photographs)))
