"""Distance field: a signed distance and body colours on a lattice, as kernels read them.

The distance between nodes is a quadratic B-spline of the 27 nodes around a place: its slope changes without steps, so
normals are smooth.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import Array3f, Float, UInt, arrays, clip, lookup
from hagoromo_recovery.field.matter_field import COLOURS, MatterField, add_to, gradient_of, no_sums
from hagoromo_recovery.field.surface_march import SurfaceMarch
from hagoromo_recovery.field.surface_moves import SurfaceMoves

if TYPE_CHECKING:
    from hagoromo_recovery.descent.pixel_table import Drawn


class Stencil(NamedTuple):
    """The 27 nodes around a place: the first one's number, and weights and their slopes along x, y and z."""

    first: UInt
    weights: list[list[Float]]
    slopes: list[list[Float]]


class DistanceField(MatterField):
    """distance: Float (nodes,) signed distance [voxel], negative inside. The axis is its slope, along the normal."""

    element, shown_around = "plane", 0
    moving = {"distance": 1, "colours": COLOURS}

    def __init__(
        self,
        distance: NDArray[np.floating],
        colours: NDArray[np.floating],
        shares: NDArray[np.floating] | None = None,
    ) -> None:
        """distance: (nz, ny, nx). colours: (nz, ny, nx, 3). shares: (nz, ny, nx)."""
        self.distance = lookup(arrays().Float, np.asarray(distance, np.float32))
        super().__init__(colours, shares)

    def no_gradients(self) -> None:
        """Gradients of 0."""
        super().no_gradients()
        self.sums_by_distance = no_sums(dr.width(self.distance))

    @property
    def by_distance(self) -> Float:
        """Float (nodes,), the gradient by distances."""
        return gradient_of(self.sums_by_distance)

    def march(self, shading: Any, softness: float, shadows: bool) -> SurfaceMarch:
        """What rays see of the surface. softness: s [voxel]. Shadows are those of a ray's mean place."""
        return SurfaceMarch(self, dr.opaque(arrays().Float, 1.0 / softness), shading)

    def moves(self) -> SurfaceMoves:
        """How its numbers follow their gradients."""
        return SurfaceMoves(self)

    def distances(self) -> NDArray[np.float32]:
        """Signed distances (nz, ny, nx) [voxel]."""
        return np.array(self.distance).reshape(self.shape)

    def plain(self) -> tuple[NDArray[np.float32], ...]:
        """Distances, body colours and, of two glosses, shares."""
        shares = self.gloss_shares()
        return self.distances(), self.body_colours(), *(() if shares is None else (shares,))

    def outline_weight(self, drawn: Drawn) -> Float:
        """That of the pixel: a surface is opaque."""
        return drawn.share_weight

    def stencil(self, place: Array3f) -> Stencil:
        """The nodes around a place; a place outside counts as the nearest one inside."""
        jit = arrays()
        first, weights, slopes = jit.UInt(0), [], []
        for k in range(3):
            middle = clip(dr.floor(dr.detach(place[k]) + 0.5), 1.0, self.last[k])
            t = clip(place[k] - middle, -0.5, 0.5)
            low, high = 0.5 - t, 0.5 + t
            weights.append([0.5 * low * low, 0.75 - t * t, 0.5 * high * high])
            slopes.append([-low, -2.0 * t, high])
            first += (jit.UInt(middle) - 1) * self.rows[k]
        return Stencil(first, weights, slopes)

    def value_at(self, place: Array3f) -> Float:
        """Signed distance [voxel]."""
        jit, s = arrays(), self.stencil(place)
        total = jit.Float(0)
        for z in range(3):
            plane = jit.Float(0)
            for y in range(3):
                row, line = s.first + self.rows[2] * z + self.rows[1] * y, jit.Float(0)
                for x in range(3):
                    line = dr.fma(s.weights[0][x], dr.gather(jit.Float, self.distance, row + x), line)
                plane = dr.fma(s.weights[1][y], line, plane)
            total = dr.fma(s.weights[2][z], plane, total)
        return total

    def axis_at(self, place: Array3f) -> Array3f:
        """Gradient of the distance."""
        jit, s = arrays(), self.stencil(place)
        slope = [jit.Float(0)] * 3
        for z in range(3):
            for y in range(3):
                row = s.first + self.rows[2] * z + self.rows[1] * y
                line, rise = jit.Float(0), jit.Float(0)
                for x in range(3):
                    node = dr.gather(jit.Float, self.distance, row + x)
                    line, rise = dr.fma(s.weights[0][x], node, line), dr.fma(s.slopes[0][x], node, rise)
                slope[0] = dr.fma(s.weights[1][y] * s.weights[2][z], rise, slope[0])
                slope[1] = dr.fma(s.slopes[1][y] * s.weights[2][z], line, slope[1])
                slope[2] = dr.fma(s.weights[1][y] * s.slopes[2][z], line, slope[2])
        return jit.Array3f(*slope)

    def add_by_value(self, place: Array3f, by: Float) -> None:
        """Add the gradient of by · value_at(place)."""
        s = self.stencil(place)
        for z in range(3):
            for y in range(3):
                row, both = s.first + self.rows[2] * z + self.rows[1] * y, by * s.weights[1][y] * s.weights[2][z]
                for x in range(3):
                    add_to(self.sums_by_distance, row + x, both * s.weights[0][x])

    def add_by_axis(self, place: Array3f, by: Array3f) -> None:
        """Add the gradient of by · axis_at(place)."""
        s = self.stencil(place)
        for z in range(3):
            for y in range(3):
                row = s.first + self.rows[2] * z + self.rows[1] * y
                rise = by[0] * s.weights[1][y] * s.weights[2][z]
                line = by[1] * s.slopes[1][y] * s.weights[2][z] + by[2] * s.weights[1][y] * s.slopes[2][z]
                for x in range(3):
                    add_to(self.sums_by_distance, row + x, dr.fma(rise, s.slopes[0][x], line * s.weights[0][x]))
