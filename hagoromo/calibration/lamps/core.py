"""Core: the widest part of a lamp's clipped image, which is the lamp; streaks and scratches are thinner than it.

The image is opened by discs of shares of its largest inscribed disc; what is left is the core. Several levels and
shares give several centres, which agree where the image is a lamp and nothing else.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.calibration.lamps.ball import Array

LEVELS, HALF = (0.9, 0.97), 0.5  # of the peak
SHARES = (0.6, 0.8, 0.95)  # of the largest inscribed disc: radii of the discs
THIN, WIDE = 2.0, 6.0  # [px] radii of inscribed discs: at THIN only the largest shares count, at WIDE the smaller ones
SAMPLES, FINEST = 20.0, 4  # samples across a radius that suffice; samples a pixel at most
BESIDE = 4  # [px] of the window around the image
BROAD, ALIKE = (
    0.7,
    0.3,
)  # share of the opened image above HALF, whose centre varies less; [px] apart at which it is halved
FLOOR = 0.1  # [px] standard error of the best core
SCATTER, ASTRAY = 1.5, 0.4  # standard error over the scatter of the centres, and over the way to the whole's centroid


class Core(NamedTuple):
    """centre (x, y), its standard error, and radius of the inscribed disc [px]; branching: area of the image above HALF
    of its peak over that of its core.
    """

    centre: Array
    standard_error: float
    radius: float
    branching: float


class _OpenedDiscs(NamedTuple):
    """Centres (shares, 2) [px], radius of the inscribed disc [px], areas (shares,) and area [px²], centroid of all."""

    centres: Array
    radius: float
    areas: Array
    area: float
    centroid: Array


def core_of(light: Array, speck: NDArray[np.bool_]) -> Core:
    """The core of the image in `light` (height, width; its peak is 1) that covers `speck`."""
    rows, columns = np.nonzero(speck)
    first = np.maximum([rows.min() - BESIDE, columns.min() - BESIDE], 0)
    box = tuple(slice(low, high + BESIDE + 1) for low, high in zip(first, (rows.max(), columns.max()), strict=True))
    window, inside = light[box], speck[box]
    half = _opened(window, inside, HALF)
    levels = [_opened(window, inside, level) for level in LEVELS]
    radius = levels[0].radius
    wide = float(np.clip((radius - THIN) / (WIDE - THIN), 0.0, 1.0))
    low, high = (one.centres for one in levels)
    thick = (low[0] + low[1] + high[0]) / 3.0
    thin = (low[2] + high[1] + high[2]) / 3.0
    centre = wide * thick + (1.0 - wide) * thin
    apart = float(np.hypot(*(half.centres[0] - centre)))
    share = BROAD / (1.0 + (apart / ALIKE) ** 2)
    centre = (1.0 - share) * centre + share * half.centres[0]
    scatter = float(np.sqrt(np.vstack([low, high]).var(axis=0).sum() / 2.0))
    aside = min(float(np.hypot(*(half.centroid - centre))), radius)
    error = float(np.sqrt(FLOOR**2 + (SCATTER * scatter) ** 2 + (ASTRAY * aside) ** 2))
    return Core(centre + first[::-1], error, radius, half.area / max(float(half.areas[0]), 1e-9))


def _opened(window: Array, inside: NDArray[np.bool_], level: float) -> _OpenedDiscs:
    """The part of the window above `level` that touches `inside` most, opened."""
    from scipy.ndimage import distance_transform_edt

    bright = _connected(window > level, inside)
    deepest = float(np.asarray(distance_transform_edt(np.pad(bright, 1))).max())
    fine = int(np.clip(SAMPLES / deepest, 1, FINEST))
    if fine > 1:
        bright = _connected(_finer(window, fine) > level, np.kron(bright, np.ones((fine, fine), np.bool_)))
    depth = np.asarray(distance_transform_edt(np.pad(bright, 1)))[1:-1, 1:-1]
    radius, centres, areas = float(depth.max()), [], []
    for share in SHARES:
        reach = share * radius
        opened = bright & (np.asarray(distance_transform_edt(depth < reach)) < reach)
        centres.append(_centroid(opened) / fine)
        areas.append(opened.sum() / fine**2)
    return _OpenedDiscs(
        np.array(centres), radius / fine, np.array(areas), bright.sum() / fine**2, _centroid(bright) / fine
    )


def _connected(bright: NDArray[np.bool_], inside: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The connected part of `bright` that has most pixels inside."""
    from skimage.measure import label

    parts = np.asarray(label(bright, connectivity=1))
    counts = np.bincount(parts[inside & bright], minlength=2)
    counts[0] = 0
    return parts == counts.argmax() if counts.any() else inside


def _finer(window: Array, fine: int) -> Array:
    """The window, `fine` samples a pixel, by linear interpolation."""
    from scipy.ndimage import map_coordinates

    at = [(np.arange(n * fine) + 0.5) / fine - 0.5 for n in window.shape]
    return np.asarray(map_coordinates(window, np.meshgrid(*at, indexing="ij"), order=1, mode="nearest"))


def _centroid(part: NDArray[np.bool_]) -> Array:
    rows, columns = np.nonzero(part)
    return np.array([columns.mean() + 0.5, rows.mean() + 0.5])
