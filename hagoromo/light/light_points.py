"""Light points: area lamps and environments as few point lamps or far lamps, as the march takes them.

An environment is cut into regions of equal light (median cut, Debevec 2005), each a far lamp at the middle of its light
with all of its irradiance. A rectangle is cut into equal parts, each a point lamp that shines as cosθ; a sphere into
patches that do so outwards. There are as many as a stated error needs: of the light that comes from one half of all
directions, over all the light, and of what it gives on a plane, over what planes get, in 100 halves. The first is what
an edge lets through too much or too little.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.directions import sunflower
from hagoromo.light.area_lamp import AreaLamp
from hagoromo.light.environment import Environment
from hagoromo.light.lamp import Lamp
from hagoromo.light.surface_emission import SurfaceEmission

COUNTS = (1, 2, 4, 8, 16, 32, 64, 128, 256)  # of points; the last is the most
FINE = 2048  # points of an area lamp that stand for all of it
HALVES = 100  # of all directions
FEWEST_ROWS = 64  # of a map: pixels of a coarser one are cut, too, so that light comes from all over each
R2 = (0.7548776662466927, 0.5698402909980532)  # steps that fill a square evenly (Roberts 2018)
TURN = 0.25  # width of a patch, in sizes of its surface, that counts as much as a turn of its normal by 1 rad
WIDEST_MAP = 128  # rows of a map up to which all its pixels are cut; of a larger one, blocks of them
Array = NDArray[np.float64]


class LightPoints(NamedTuple):
    """Point lamps or far lamps in place of a light, how many places they are at, and their error."""

    lamps: list[Lamp]
    places: int
    error: float


def environment_points(environment: Environment, tolerance: float) -> LightPoints:
    """Far lamps in place of an environment, those of its parts together at each place."""
    ways, light = _blocks(_cut_pixels(environment))  # (rows, columns, 3) times their light, (rows, columns, parts)
    total = light.sum(axis=2)
    unit = ways / np.maximum(np.linalg.norm(ways, axis=2, keepdims=True), 1e-300)
    truth = _halves(unit.reshape(-1, 3), total.ravel())
    for count in COUNTS:
        cut = [(ways[region].sum(axis=(0, 1)), light[region].sum(axis=(0, 1))) for region in _regions(total, count)]
        middles = np.array([way / np.linalg.norm(way) for way, _ in cut])
        error = _error(_halves(middles, np.array([each.sum() for _, each in cut])), truth)
        if error <= tolerance or len(cut) < count:
            break
    lamps = [
        Lamp(to_lamp=way, intensity=float(irradiance), spectrum=part.spectrum, name=part.name)
        for way, (_, each) in zip(middles, cut, strict=True)
        for part, irradiance in zip(environment.parts, each, strict=True)
    ]
    return LightPoints(lamps, len(cut), error)


def area_points(lamp: AreaLamp, low: Array, high: Array, tolerance: float) -> LightPoints:
    """Point lamps in place of an area lamp that lights what is between the corners `low` and `high` (3,) [m]."""
    probes = low + (high - low) * 0.5 * np.array(list(np.ndindex(3, 3, 3)), np.float64)
    fine = area_lamp_points(lamp, FINE)
    truth = [_light_at(probe, fine) for probe in probes]
    for count in COUNTS:
        lamps = area_lamp_points(lamp, count)
        error = max(_error(_light_at(probe, lamps), whole) for probe, whole in zip(probes, truth, strict=True))
        if error <= tolerance:
            break
    return LightPoints(lamps, len(lamps), error)


def _cut_pixels(environment: Environment) -> Environment:
    """The same light as a map of FEWEST_ROWS or more, by cutting each pixel in equal parts."""
    parts = -(-FEWEST_ROWS // environment.values.shape[0])
    if parts == 1:
        return environment
    values = environment.values.repeat(parts, axis=0).repeat(parts, axis=1)
    return replace(environment, values=values)


def emitter_points(corners: Array, emission: SurfaceEmission, low: Array, high: Array, tolerance: float) -> LightPoints:
    """Point lamps in place of triangles (n, 3, 3) [m] whose fronts give off light, as `area_points` has them."""
    places, normals, area = spread_over(corners, FINE)
    probes = low + (high - low) * 0.5 * np.array(list(np.ndindex(3, 3, 3)), np.float64)
    each = np.full(FINE, emission.radiance * area / FINE)
    truth = [_light_of(probe, places, normals, each) for probe in probes]
    for count in COUNTS:
        patches = _patches(places, normals, count)
        middles = np.array([_middle(places[patch], normals[patch]) for patch in patches])
        sums = np.array([normals[patch].sum(axis=0) for patch in patches])
        length = np.maximum(np.linalg.norm(sums, axis=1), 1e-12)
        axes, strengths = sums / length[:, None], emission.radiance * area / FINE * length
        error = max(_error(_light_of(p, middles, axes, strengths), t) for p, t in zip(probes, truth, strict=True))
        if error <= tolerance:
            break
    lamps = [
        Lamp(place, intensity=float(strength), spectrum=emission.spectrum, name=emission.name, axis=axis)
        for place, axis, strength in zip(middles, axes, strengths, strict=True)
    ]
    return LightPoints(lamps, len(lamps), error)


def spread_over(corners: Array, count: int) -> tuple[Array, Array, float]:
    """`count` places on triangles (n, 3, 3), spread evenly over their area; the normals there; and the area."""
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = 0.5 * np.linalg.norm(across, axis=1)
    sums = np.cumsum(areas)
    share = (np.arange(count) + 0.5) / count * sums[-1]
    face = np.minimum(np.searchsorted(sums, share, side="right"), len(areas) - 1)
    u, v = np.modf(np.outer(np.arange(count) + 0.5, R2))[0].T
    root = np.sqrt(u)
    weights = np.stack([1.0 - root, root * (1.0 - v), root * v], axis=-1)
    places = (weights[:, :, None] * corners[face]).sum(axis=1)
    return places, (across / (2.0 * areas[:, None]))[face], float(sums[-1])


def _patches(places: Array, normals: Array, count: int) -> list[NDArray[np.intp]]:
    """Numbers of places in `count` patches of equal size, each halved where it is widest, in place or normal."""
    size = max(float(np.ptp(places, axis=0).max()), 1e-30)
    both = np.concatenate([places / size, TURN * normals], axis=1)
    patches = [np.arange(len(places))]
    while len(patches) < count:
        halves = []
        for patch in patches:
            widest = int(np.argmax(both[patch].var(axis=0)))
            order = patch[np.argsort(both[patch, widest], kind="stable")]
            halves += [order[: len(order) // 2], order[len(order) // 2 :]]
        patches = halves
    return patches


def _middle(places: Array, normals: Array) -> Array:
    """The middle of a patch; where it is bent the place on it that is nearest, which nothing of it hides."""
    middle = places.mean(axis=0)
    if (np.ptp(normals, axis=0) < 1e-9).all():
        return middle
    return places[np.argmin(np.sum((places - middle) ** 2, axis=1))]


def _light_of(point: Array, places: Array, axes: Array, strengths: Array) -> Array:
    """`_halves` of what lamps give at a point that shine as cosθ about their axes."""
    away = places - point
    distance = np.maximum(np.linalg.norm(away, axis=1), 1e-12)
    ways = away / distance[:, None]
    facing = np.maximum(-(axes * ways).sum(axis=1), 0.0)
    return _halves(ways, strengths * facing / distance**2)


def _blocks(environment: Environment) -> tuple[Array, Array]:
    """Of blocks of pixels: their light [irradiance] times the unit direction it comes from, (rows, columns, 3), and
    their light, (rows, columns, parts).
    """
    height, width = environment.values.shape[:2]
    side = -(-height // WIDEST_MAP)
    light = np.stack([part.radiance for part in environment.parts], axis=-1) * environment.solid_angles[:, None, None]
    rows, columns = np.meshgrid(np.arange(height) + 0.5, np.arange(width) + 0.5, indexing="ij")
    # of a dark pixel, too, the direction is kept
    ways = environment.directions(rows, columns) * np.maximum(light.sum(axis=2, keepdims=True), 1e-30)
    sums = [
        np.add.reduceat(np.add.reduceat(v, range(0, height, side)), range(0, width, side), 1) for v in (ways, light)
    ]
    return sums[0], sums[1]


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


def area_lamp_points(lamp: AreaLamp, count: int) -> list[Lamp]:
    """`count` point lamps, all alike, spread over an area lamp."""
    places, axes = lamp.shape.points(count)
    if axes is None:
        each = lamp.radiance * lamp.shape.far_area / count
        return [Lamp(lamp.position + place, intensity=each, spectrum=lamp.spectrum, name=lamp.name) for place in places]
    each = lamp.radiance * lamp.area / count
    return [
        Lamp(lamp.position + place, intensity=each, spectrum=lamp.spectrum, name=lamp.name, axis=axis)
        for place, axis in zip(places, axes, strict=True)
    ]


def _light_at(point: Array, lamps: Sequence[Lamp]) -> Array:
    """`_halves` of what point lamps give there."""
    places = np.array([lamp.position for lamp in lamps])
    away = places - point
    distance = np.maximum(np.linalg.norm(away, axis=1), 1e-12)
    ways = away / distance[:, None]
    facing = np.ones(len(lamps)) if lamps[0].axis is None else np.array([-lamp.axis for lamp in lamps]) * ways  # type: ignore[operator]
    facing = facing if facing.ndim == 1 else np.maximum(facing.sum(axis=1), 0.0)
    return _halves(ways, float(lamps[0].intensity) * facing / distance**2)  # type: ignore[arg-type]


def _halves(ways: Array, light: Array) -> Array:
    """Of light (n,) from unit directions (n, 3): what comes from each of HALVES, and what it gives there on a plane
    that faces its middle; then all of the light: (3, HALVES).
    """
    cosine = ways @ sunflower(HALVES).T
    sums = (cosine > 0.0).T @ light, np.maximum(cosine, 0.0).T @ light
    return np.array([*sums, np.full(HALVES, light.sum())])


def _error(few: Array, whole: Array) -> float:
    """The largest of the root mean squares of the three differences: those of halves and of all over all of the light,
    that of planes over the root mean square of what they get; 0 where there is no light.
    """
    if not whole[2, 0] > 0.0:
        return 0.0
    sizes = np.array([whole[2, 0], math.sqrt(np.mean(whole[1] ** 2)), whole[2, 0]])
    return float((np.sqrt(np.mean((few - whole) ** 2, axis=1)) / sizes).max())
