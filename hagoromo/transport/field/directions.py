"""Directions of a sweep, and their turns.

The 12 corners of an icosahedron integrate polynomials up to the fifth degree exactly; products of two functions of the
second order are of the fourth. They are turned at random, and the errors of many turns cancel.
"""

from __future__ import annotations

import itertools
import math

import numpy as np
from numpy.typing import NDArray

GOLDEN = (1.0 + math.sqrt(5.0)) / 2.0
SIGNS = list(itertools.product((1.0, -1.0), repeat=2))


def directions() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Unit directions (12, 3) and their weights [sr], whose sum is 4π."""
    ways = np.array([way for a, b in SIGNS for way in _turned(0.0, a, b * GOLDEN)])
    return ways / np.linalg.norm(ways, axis=1, keepdims=True), np.full(12, 4.0 * math.pi / 12)


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
