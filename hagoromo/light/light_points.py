"""Light points: few point lamps or far lamps in place of a light, as the march takes them, and their error.

There are as many as a stated error needs: of the light that comes from one half of all directions, over all the light,
and of what it gives on a plane, over what planes get, in 100 halves. The first is what an edge lets through too much or
too little.
"""

from __future__ import annotations

import heapq
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.directions import sunflower
from hagoromo.light.lamp import Lamp

COUNTS = (1, 2, 4, 8, 16, 32, 64, 128, 256)  # of points; the last is the most
FINE = 2048  # points that stand for all of a light with a size
HALVES = 100  # of all directions
Array = NDArray[np.float64]
FEWEST_ROWS = 64  # of a map: pixels of a coarser one are cut, too, so that light comes from all over each
WIDEST_MAP = 128  # rows of a map up to which all its pixels are cut; of a larger one, blocks of them


class LightPoints(NamedTuple):
    """Point lamps or far lamps in place of a light, how many places they are at, and their error."""

    lamps: list[Lamp]
    places: int
    error: float


class PointSources(NamedTuple):
    """Places (n, 3) [m], the axes (n, 3) about which they shine as cosθ, None: alike all around, and their
    strengths (n,) [W/sr].
    """

    places: Array
    axes: Array | None
    strengths: Array


def probes_between(low: Array, high: Array) -> Array:
    """27 places (n, 3) [m] of the cuboid between two corners, where the error of light is looked at."""
    return low + (high - low) * 0.5 * np.array(list(np.ndindex(3, 3, 3)), np.float64)


def error_of_points(few: PointSources, truth: list[Array], probes: Array) -> float:
    """The largest error at the probes; truth: `light_at` each of them."""
    return max(error_of(light_at(probe, few), whole) for probe, whole in zip(probes, truth, strict=True))


def light_at(point: Array, sources: PointSources) -> Array:
    """`halves_of` what point sources give at a point."""
    away = sources.places - point
    distance = np.maximum(np.linalg.norm(away, axis=1), 1e-12)
    ways = away / distance[:, None]
    facing = np.ones(len(ways)) if sources.axes is None else np.maximum(-(sources.axes * ways).sum(axis=1), 0.0)
    return halves_of(ways, sources.strengths * facing / distance**2)


def halves_of(ways: Array, light: Array) -> Array:
    """Of light (n,) from unit directions (n, 3): what comes from each of HALVES, and what it gives there on a plane
    that faces its middle; then all of the light: (3, HALVES).
    """
    cosine = ways @ sunflower(HALVES).T
    sums = (cosine > 0.0).T @ light, np.maximum(cosine, 0.0).T @ light
    return np.array([*sums, np.full(HALVES, light.sum())])


def error_of(few: Array, whole: Array) -> float:
    """The largest of the root mean squares of the three differences: those of halves and of all over all of the light,
    that of planes over the root mean square of what they get; 0 where there is no light.
    """
    if not whole[2, 0] > 0.0:
        return 0.0
    sizes = np.array([whole[2, 0], math.sqrt(np.mean(whole[1] ** 2)), whole[2, 0]])
    return float((np.sqrt(np.mean((few - whole) ** 2, axis=1)) / sizes).max())


def cut_light(ways: Array, light: Array, tolerance: float) -> tuple[Array, Array, float]:
    """Directions (n, 3) of regions of equal light, the light of each part from them (n, parts), and their error.

    Median cut (Debevec 2005). ways: (rows, columns, 3) unit, of the pixels of an equirectangular map. light: (rows,
    columns, parts), irradiance.
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
