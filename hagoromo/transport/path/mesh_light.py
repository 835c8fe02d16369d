"""Mesh light: directions towards the triangles of a surface that gives off light, drawn evenly over their area."""

from __future__ import annotations

import math

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import Array3f, Float, arrays, check_entries, lookup, opaque_vector
from hagoromo.light.shapes.lamp_shape import LightDrawn
from hagoromo.light.surface_emission import SurfaceEmission
from hagoromo.transport.path.environment_light import interval_of, shares_before


class MeshLight:
    """Triangles (n, 3, 3) [m] that shine from their fronts; walks hit them as surfaces. See `SphereLight`."""

    def __init__(self, corners: NDArray[np.float64], emission: SurfaceEmission) -> None:
        jit = arrays()
        check_entries(12 * len(corners), f"the triangles of {emission.name!r}")
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        double = np.linalg.norm(across, axis=1)
        self.count, self.shares = len(corners), lookup(jit.Float, shares_before(double))
        sides = np.stack([corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=1)
        rows = np.concatenate([sides.reshape(-1, 9), across / double[:, None]], axis=1)
        self.rows = lookup(jit.Float, rows.astype(np.float32))
        self.middle = opaque_vector((double[:, None] * corners.mean(axis=1)).sum(axis=0) / double.sum())
        self.area, self.radiance = (dr.opaque(jit.Float, x) for x in (0.5 * float(double.sum()), emission.radiance))
        dr.eval(self.shares, self.rows)

    def share(self, point: Array3f) -> Float:
        """About the irradiance that it gives on what faces it, without shadows."""
        squared = dr.squared_norm(self.middle - point)
        return 2.0 * math.pi * self.radiance * self.area / (self.area + 2.0 * math.pi * squared)

    def drawn(self, point: Array3f, u: Float, v: Float) -> LightDrawn:
        """A direction by two uniform numbers."""
        jit = arrays()
        face = interval_of(self.shares, self.count, u, jit.UInt(0))
        below, above = (dr.gather(jit.Float, self.shares, face + k) for k in (0, 1))
        again = dr.fmin(dr.fmax((u - below) / dr.fmax(above - below, 1e-30), 0.0), 1.0)
        first, second, third, normal = (
            jit.Array3f(*(dr.gather(jit.Float, self.rows, face * 12 + (3 * k + j)) for j in range(3))) for k in range(4)
        )
        root = dr.sqrt(again)
        away = first + second * (root * (1.0 - v)) + third * (root * v) - point
        distance = dr.norm(away)
        way = away / dr.fmax(distance, 1e-30)
        return LightDrawn(way, distance, self.density(distance, -dr.dot(way, normal)))

    def density(self, distance: Float, cosine: Float) -> Float:
        """Of directions to a place on it, at a distance, that is seen at a cosine from its normal [1/sr]."""
        return dr.select(cosine > 0.0, distance * distance / (self.area * dr.fmax(cosine, 1e-30)), 0.0)
