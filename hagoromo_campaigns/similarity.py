"""Similarity: a rotation, a shift and one scale, and the one that brings points nearest to others."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Similarity:
    """x → scale · rotation x + shift. rotation: (3, 3). shift: (3,) [m]."""

    scale: float
    rotation: Array
    shift: Array

    def points(self, points: Array) -> Array:
        """Points (…, 3) after it."""
        return self.scale * points @ self.rotation.T + self.shift

    def directions(self, directions: Array) -> Array:
        """Unit vectors (…, 3) after it."""
        return directions @ self.rotation.T

    @property
    def inverse(self) -> Similarity:
        """The way back."""
        return Similarity(1.0 / self.scale, self.rotation.T, -self.rotation.T @ self.shift / self.scale)

    def moved(self, turn: Array, shift: Array, log_scale: float, centre: Array) -> Similarity:
        """It with a further turn (3,) [rad] and change of scale about `centre`, in the world it leads to, and shift."""
        from scipy.spatial.transform import Rotation

        rotation, scale = Rotation.from_rotvec(turn).as_matrix(), float(np.exp(log_scale))
        moved = scale * rotation @ (self.shift - centre) + centre + shift
        return Similarity(scale * self.scale, rotation @ self.rotation, moved)

    def record(self) -> dict[str, Any]:
        """As JSON files have it."""
        return {"scale": self.scale, "rotation": self.rotation.tolist(), "shift": self.shift.tolist()}


def nearest_similarities(a: Array, b: Array) -> tuple[Array, Array, Array]:
    """Scales (n,), rotations (n, 3, 3) and shifts (n, 3) that bring points a (n, m, 3) nearest to b (n, m, 3).

    Umeyama 1991, "Least-squares estimation of transformation parameters between two point patterns".
    """
    mean_a, mean_b = a.mean(axis=1, keepdims=True), b.mean(axis=1, keepdims=True)
    centred_a, centred_b = a - mean_a, b - mean_b
    u, sizes, vt = np.linalg.svd(np.einsum("nmi,nmj->nij", centred_b, centred_a))
    signs = np.ones_like(sizes)
    signs[:, 2] = np.sign(np.linalg.det(u @ vt))
    rotation = (u * signs[:, None]) @ vt
    scale = (sizes * signs).sum(axis=1) / np.maximum((centred_a**2).sum(axis=(1, 2)), 1e-300)
    shift = mean_b[:, 0] - scale[:, None] * np.einsum("nij,nj->ni", rotation, mean_a[:, 0])
    return scale, rotation, shift
