"""Directions of a sweep, and their turns.

The 12 corners of an icosahedron integrate polynomials up to the fifth degree exactly; products of two functions of the
second order are of the fourth. Together with the 20 of a dodecahedron, weighed 25 and 27, up to the ninth: for sweeps
whose errors would add up. Others are turned at random, each for itself, and their errors cancel.
"""

from __future__ import annotations

import itertools
import math

import numpy as np
from numpy.typing import NDArray

GOLDEN = (1.0 + math.sqrt(5.0)) / 2.0
SIGNS = list(itertools.product((1.0, -1.0), repeat=2))


def few_directions() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Unit directions (12, 3) and their weights [sr], whose sum is 4π."""
    ways = np.array([way for a, b in SIGNS for way in _turned(0.0, a, b * GOLDEN)])
    return ways / np.linalg.norm(ways, axis=1, keepdims=True), np.full(12, 4.0 * math.pi / 12)


def many_directions() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Unit directions (32, 3) and their weights [sr], whose sum is 4π."""
    cube = list(itertools.product((1.0, -1.0), repeat=3))
    ways = np.array(cube + [way for a, b in SIGNS for way in _turned(0.0, a * GOLDEN, b / GOLDEN)])
    ways = np.concatenate([few_directions()[0], ways / math.sqrt(3.0)])
    return ways, np.repeat([25.0, 27.0], [12, 20]) * (4.0 * math.pi / 840.0)


def _turned(x: float, y: float, z: float) -> list[tuple[float, float, float]]:
    return [(x, y, z), (z, x, y), (y, z, x)]


def turn(random: np.random.Generator) -> NDArray[np.float64]:
    """A rotation, uniform among all: (3, 3), of a unit quaternion (Shoemake 1992)."""
    w, x, y, z = (q := random.normal(size=4)) / np.linalg.norm(q)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
