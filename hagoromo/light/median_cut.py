"""Median cut: light from all around as few directions, each with the light of a region of its map (Debevec 2005)."""

from __future__ import annotations

import heapq
import math

import numpy as np
from numpy.typing import NDArray

from hagoromo.light.light_points import COUNTS, error_of, halves_of

FEWEST_ROWS = 64  # of a map: pixels of a coarser one are cut, too, so that light comes from all over each
WIDEST_MAP = 128  # rows of a map up to which all its pixels are cut; of a larger one, blocks of them
Array = NDArray[np.float64]


def cut_light(ways: Array, light: Array, tolerance: float) -> tuple[Array, Array, float]:
    """Directions (n, 3) of regions of equal light, the light of each part from them (n, parts), and their error.

    ways: (rows, columns, 3) unit, of the pixels of an equirectangular map. light: (rows, columns, parts), irradiance.
    """
    # of a dark pixel, too, the direction is kept
    ways, light = _blocks(ways * np.maximum(light.sum(axis=2, keepdims=True), 1e-30)), _blocks(light)
    total = light.sum(axis=2)
    unit = ways / np.maximum(np.linalg.norm(ways, axis=2, keepdims=True), 1e-300)
    truth = halves_of(unit.reshape(-1, 3), total.ravel())
    for count in COUNTS:
        cut = [(ways[region].sum(axis=(0, 1)), light[region].sum(axis=(0, 1))) for region in _regions(total, count)]
        middles = np.array([way / np.linalg.norm(way) for way, _ in cut])
        error = error_of(halves_of(middles, np.array([each.sum() for _, each in cut])), truth)
        if error <= tolerance or len(cut) < count:
            break
    return middles, np.array([each for _, each in cut]), error


def _blocks(values: Array) -> Array:
    """Sums over blocks of pixels of a map (rows, columns, k)."""
    height, width = values.shape[:2]
    side = -(-height // WIDEST_MAP)
    return np.add.reduceat(np.add.reduceat(values, range(0, height, side)), range(0, width, side), 1)


def _regions(light: Array, count: int) -> list[tuple[slice, slice]]:
    """At most `count` regions of a map, each cut where half of its light is: first the one of most light and width."""
    height, width = light.shape
    sums = np.pad(light.cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))
    whole: list[tuple[float, int, int, int, int]] = []
    done = []

    def put(top: int, bottom: int, left: int, right: int) -> None:
        held = sums[bottom, right] - sums[top, right] - sums[bottom, left] + sums[top, left]
        solid = (math.cos(math.pi * top / height) - math.cos(math.pi * bottom / height)) * (right - left)
        heapq.heappush(whole, (-float(held) * math.sqrt(solid), top, bottom, left, right))

    put(0, height, 0, width)
    while whole and len(whole) + len(done) < count:
        _, top, bottom, left, right = region = heapq.heappop(whole)
        middle = math.sin(math.pi * 0.5 * (top + bottom) / height)
        down, across = bottom - top, 2.0 * (right - left) * middle * height / width
        if max(bottom - top, right - left) == 1:
            done.append(region)
        elif right - left == 1 or (down >= across and bottom - top > 1):
            at = top + _half(light[top:bottom, left:right].sum(axis=1))
            put(top, at, left, right)
            put(at, bottom, left, right)
        else:
            at = left + _half(light[top:bottom, left:right].sum(axis=0))
            put(top, bottom, left, at)
            put(top, bottom, at, right)
    every = [*done, *whole]
    lit = [
        (slice(top, bottom), slice(left, right)) for _, top, bottom, left, right in sorted(every, key=lambda r: r[1:])
    ]
    return [region for region in lit if light[region].any()]


def _half(light: Array) -> int:
    """Where a row of two or more entries is cut: half of its light is on either side, about."""
    sums = np.cumsum(light)
    return int(np.clip(np.searchsorted(sums, 0.5 * sums[-1]) + 1, 1, len(light) - 1))
