"""Lattice: where the nodes of a recovery stand in the world."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

Array = NDArray[np.float64]
LEAST_SIDE, LARGEST_SIDE = 16, 512  # nodes along the longest edge of a recovery
MARGIN = 3  # nodes of the old lattice that are kept free around the surface


@dataclass(frozen=True, eq=False)
class Lattice:
    """corner: (3,) world place of the first node [m]. voxel: distance between nodes [m]. shape: nodes (z, y, x)."""

    corner: Array
    voxel: float
    shape: tuple[int, int, int]

    @staticmethod
    def around(low: Array, high: Array, side: int) -> Lattice:
        """The lattice over a box between two corners [m], of `side` nodes along its longest edge."""
        voxel = float((high - low).max()) / (side - 1)
        x, y, z = (max(int(np.ceil(edge / voxel - 1e-9)) + 1, 4) for edge in high - low)
        middle = 0.5 * (low + high)
        corner = middle - 0.5 * voxel * (np.array([x, y, z]) - 1.0)
        return Lattice(corner, voxel, (z, y, x))

    def around_surface(self, distance: NDArray[np.floating], side: int) -> Lattice:
        """A lattice of `side` nodes around what is inside (distance < 0, at nodes) with a margin, within this one."""
        inside = np.argwhere(distance < 1.0)[:, ::-1]
        if not len(inside):
            return Lattice.around(self.corner, self.high, side)
        first, last = inside.min(axis=0) - MARGIN, inside.max(axis=0) + MARGIN
        low, high = np.maximum(self.to_world(first), self.corner), np.minimum(self.to_world(last), self.high)
        return Lattice.around(low, high, side)

    def resampled(self, values: NDArray[np.floating], new: Lattice) -> NDArray[np.float32]:
        """Values (nz, ny, nx[, k]) at the nodes of a new lattice: trilinear, outside as at the edge."""
        at = np.moveaxis(self.from_world(new.nodes())[..., ::-1], 3, 0)
        parts = values[..., None] if values.ndim == 3 else values
        sampled = [ndimage.map_coordinates(parts[..., k], at, order=1, mode="nearest") for k in range(parts.shape[3])]
        return np.stack(sampled, axis=3).reshape(*new.shape, *values.shape[3:]).astype(np.float32)

    def from_world(self, points: ArrayLike) -> Array:
        """World points (..., 3) [m] in lattice coordinates (x, y, z)."""
        return (np.asarray(points, float) - self.corner) / self.voxel

    def to_world(self, places: ArrayLike) -> Array:
        """Lattice coordinates (..., 3) in the world [m]."""
        return np.asarray(places, float) * self.voxel + self.corner

    def nodes(self) -> Array:
        """World places of all nodes (nz, ny, nx, 3) [m]."""
        z, y, x = np.meshgrid(*(np.arange(n) for n in self.shape), indexing="ij")
        return self.to_world(np.stack([x, y, z], axis=3))

    @property
    def high(self) -> Array:
        """(3,) world place of the last node [m]."""
        return self.to_world(np.array(self.shape[::-1]) - 1.0)

    @property
    def middle(self) -> Array:
        """(3,) its middle in the world [m]."""
        return 0.5 * (self.corner + self.high)
