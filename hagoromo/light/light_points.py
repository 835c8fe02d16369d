"""Light points: few point lamps or far lamps in place of a light, as the march takes them, and their error.

There are as many as a stated error needs: of the light that comes from one half of all directions, over all the light,
and of what it gives on a plane, over what planes get, in 100 halves. The first is what an edge lets through too much or
too little.
"""

from __future__ import annotations

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
