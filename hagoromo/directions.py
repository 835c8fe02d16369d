"""Directions: axes about one, on the device, and directions that are spread evenly over the sphere."""

from __future__ import annotations

import math

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import Array3f

GOLDEN = math.pi * (3.0 - math.sqrt(5.0))  # [rad], turn between neighbours


def sunflower(count: int) -> NDArray[np.float64]:
    """Unit directions (count, 3)."""
    z = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    turn, aside = GOLDEN * np.arange(count), np.sqrt(1.0 - z * z)
    return np.stack([aside * np.cos(turn), aside * np.sin(turn), z], axis=1)


def turned_z_to(direction: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3, 3): a rotation whose third column is `direction`, unit."""
    side = np.cross((0.0, 1.0, 0.0) if abs(direction[1]) < 0.9 else (1.0, 0.0, 0.0), direction)
    side /= np.linalg.norm(side)
    return np.stack([side, np.cross(direction, side), direction], axis=1)


def frame_about(normal: Array3f) -> tuple[Array3f, Array3f, Array3f]:
    """Two unit vectors across a unit `normal` and the normal itself (Duff et al. 2017)."""
    kind = type(normal)
    sign = dr.select(normal.z >= 0.0, 1.0, -1.0)
    a = -dr.rcp(sign + normal.z)
    b = normal.x * normal.y * a
    one = kind(1.0 + sign * normal.x * normal.x * a, sign * b, -sign * normal.x)
    return one, kind(b, sign + normal.y * normal.y * a, -normal.y), normal


def local(frame: tuple[Array3f, Array3f, Array3f], vector: Array3f) -> Array3f:
    """A vector in the axes of `frame`."""
    return type(vector)(*(dr.dot(vector, axis) for axis in frame))
