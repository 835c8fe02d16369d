"""Height field: one surface over the pixels of an object, so that its normals are integrable.

Unknown at the corners of the pixels: u, ln of the distance along the ray; in an orthographic view, the distance in
pixels. With the rays (x', y', −1), x right, y up, the normal is along (u_x, u_y, 1 + x' u_x + y' u_y).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.measurement.normals.views import Array

CORNERS = ((0, 0), (0, 1), (1, 0), (1, 1))
STEEPEST = 5.0  # largest slope of a normal at the start of a height field
REWEIGHTINGS = 6  # of the start; it is not tested for convergence, since a fit of the surface follows


@dataclass(frozen=True, eq=False)
class HeightField:
    """slopes: u (V,) → u_x and u_y (P,), sparse. saddle: → the chessboard, of slope 0. tangent: (P, 2) x', y'."""

    slopes: tuple[Any, Any]
    saddle: Any
    tangent: Array

    @property
    def to_eye(self) -> Array:
        """(P, 3) unit."""
        rays = np.column_stack([-self.tangent, np.ones(len(self.tangent))])
        return rays / np.linalg.norm(rays, axis=1, keepdims=True)

    def normals(self, depth: Array) -> tuple[Array, Array]:
        """Unit normals (P, 3) of u (V,), and their derivatives (2, P, 3) by u_x and u_y, up to parts along them."""
        x, y = self.tangent.T
        across, along = (slope @ depth for slope in self.slopes)
        normal = np.column_stack([across, along, 1.0 + x * across + y * along])
        length = np.linalg.norm(normal, axis=1, keepdims=True)
        one, zero = np.ones_like(x), np.zeros_like(x)
        by = np.stack([np.column_stack([one, zero, x]), np.column_stack([zero, one, y])])
        return normal / length, by / length

    def through(self, normals: Array) -> Array:
        """u (V,) from `normals` (P, 3) of any length, by robust least squares: a start for a fit of the surface."""
        from scipy.sparse import diags, eye_array
        from scipy.sparse.linalg import splu

        floor = 0.1 * np.linalg.norm(normals, axis=1)
        facing = np.maximum(normals[:, 2] - np.sum(normals[:, :2] * self.tangent, axis=1), floor)
        wanted = np.clip(normals[:, :2] / facing[:, None], -STEEPEST, STEEPEST)
        flat = 1.0 / (1.0 + np.sum(wanted**2, axis=1))
        weight, depth = np.ones(len(wanted)), np.zeros(self.saddle.shape[1])
        regulariser = 1e-2 * self.saddle.T @ self.saddle + 1e-7 * eye_array(len(depth))
        for _ in range(REWEIGHTINGS):
            each = diags(weight * flat**2)
            square, rhs = regulariser, np.zeros(len(depth))
            for i, slope in enumerate(self.slopes):
                square = square + slope.T @ each @ slope
                rhs = rhs + slope.T @ (each @ wanted[:, i])
            depth = splu(square.tocsc()).solve(rhs)
            off = flat * np.hypot(*(slope @ depth - wanted[:, i] for i, slope in enumerate(self.slopes)))
            weight = 1.0 / (1.0 + (off / (3.0 * float(np.median(off)) + 1e-9)) ** 2)
        return np.asarray(depth)


def height_field(mask: NDArray[np.bool_], tangent: Array) -> HeightField:
    """The field over the pixels of `mask` (h, w); tangent: (h, w, 2) x', y' of the rays, 0 from afar."""
    from scipy.sparse import csr_array

    pixels = np.argwhere(mask)
    node = np.full((mask.shape[0] + 1, mask.shape[1] + 1), -1)
    places = [(pixels[:, 0] + down, pixels[:, 1] + right) for down, right in CORNERS]
    for place in places:
        node[place] = 0
    node[node == 0] = np.arange(np.count_nonzero(node == 0))
    columns = np.concatenate([node[place] for place in places])
    rows = np.tile(np.arange(len(pixels)), len(CORNERS))
    afar = not tangent.any()
    wide = 1.0 if afar else abs(tangent[0, 1, 0] - tangent[0, 0, 0])
    high = 1.0 if afar else abs(tangent[0, 0, 1] - tangent[1, 0, 1])

    def differences(signs: tuple[float, ...], pitch: float) -> Any:
        values = np.repeat(0.5 * np.array(signs) / pitch, len(pixels))
        return csr_array((values, (rows, columns)), shape=(len(pixels), int(node.max()) + 1))

    slopes = differences((-1, 1, -1, 1), wide), differences((1, 1, -1, -1), high)
    return HeightField(slopes, differences((1, -1, -1, 1), wide), tangent[mask])
