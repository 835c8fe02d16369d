"""Sphere: an area lamp that shines outwards, such as a frosted bulb."""

from __future__ import annotations

import math
from typing import Annotated, Any

import drjit as dr
import numpy as np

from hagoromo.backend import Array3f, Float, arrays, opaque_vector
from hagoromo.directions import frame_about, sunflower
from hagoromo.files.record import Positive, about
from hagoromo.light.shapes.lamp_shape import AreaLight, Array, LampShape, LightSeen, PointsOfShape
from hagoromo.light.wide_light import LightDrawn


class Sphere(LampShape, frozen=True, kw_only=True):
    """A sphere about the place of the lamp."""

    radius: Annotated[Positive, about("radius of a round lamp, which shines outwards; alone: of a sphere [m]")]

    @property
    def area(self) -> float:
        """4π r²."""
        return 4.0 * math.pi * self.radius**2

    def corners(self) -> Array:
        """Two corners of its bounds."""
        return np.outer((-1.0, 1.0), np.full(3, self.radius))

    def points(self, count: int) -> PointsOfShape:
        """Its middle, or places spread evenly over it."""
        if count == 1:
            return PointsOfShape(np.zeros((1, 3)), None)
        axes = sunflower(count)
        return PointsOfShape(self.radius * axes, axes)

    def on_device(self, position: Array, radiance: float, visible: bool) -> SphereLight:
        """See `LampShape`."""
        return SphereLight(position, self.radius, radiance, visible)

    def mitsuba(self, position: Array) -> tuple[str, dict[str, Any]]:
        """See `LampShape`."""
        return "sphere", {"center": position, "radius": self.radius}

    def usd(self) -> tuple[str, Array, dict[str, float]]:
        """See `LampShape`."""
        return "SphereLight", np.eye(3), {"radius": self.radius}


class SphereLight(AreaLight):
    """A sphere that shines outwards. Directions are uniform within its cone."""

    def __init__(self, position: Array, radius: float, radiance: float, visible: bool) -> None:
        jit = arrays()
        self.centre, self.visible = opaque_vector(position), visible
        self.radius, self.radiance = (dr.opaque(jit.Float, float(x)) for x in (radius, radiance))

    def share(self, point: Array3f) -> Float:
        """Irradiance that it gives on what faces it, without shadows; 0 within it."""
        squared = dr.squared_norm(self.centre - point)
        inside = squared <= self.radius * self.radius
        return dr.select(inside, 0.0, math.pi * self.radiance * self.radius * self.radius / squared)

    def drawn(self, point: Array3f, u: Float, v: Float, *further: Float) -> LightDrawn:
        """A direction by two uniform numbers."""
        away = self.centre - point
        squared, cap = dr.squared_norm(away), self._cap(point)
        along = away * dr.rsqrt(squared)
        fall = u * cap  # 1 − cosine from the middle
        sine, (turn_sine, turn_cosine) = dr.sqrt(dr.fmax(fall * (2.0 - fall), 0.0)), dr.sincos(2.0 * math.pi * v)
        one, other, _ = frame_about(along)
        way = dr.normalize(along * (1.0 - fall) + (one * turn_cosine + other * turn_sine) * sine)
        distance = dr.sqrt(squared)
        inner = dr.fmax(self.radius * self.radius - squared * sine * sine, 0.0)
        density = dr.select(cap > 0.0, 1.0 / (2.0 * math.pi * cap), 0.0)
        return LightDrawn(way, distance * (1.0 - fall) - dr.sqrt(inner), density)

    def seen(self, point: Array3f, direction: Array3f) -> LightSeen:
        """What is seen of it from a point in a unit direction."""
        away, cap = self.centre - point, self._cap(point)
        along = dr.dot(away, direction)
        inner = self.radius * self.radius - dr.squared_norm(away - direction * along)
        there = (inner > 0.0) & (along > 0.0) & (cap > 0.0)
        distance = along - dr.sqrt(dr.fmax(inner, 0.0))
        return LightSeen(there, distance, dr.select(there, 1.0 / (2.0 * math.pi * dr.fmax(cap, 1e-30)), 0.0))

    def _cap(self, point: Array3f) -> Float:
        """1 − cosine of half its angle; 0 within it."""
        sine = self.radius * self.radius / dr.squared_norm(self.centre - point)
        return dr.select(sine < 1.0, sine / (1.0 + dr.sqrt(dr.fmax(1.0 - sine, 0.0))), 0.0)
