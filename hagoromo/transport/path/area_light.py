"""Area light: directions towards a sphere or a rectangle that shines, drawn by the solid angle that a point sees.

A sphere's are uniform within its cone; a rectangle's are uniform within its spherical rectangle (Ureña, Fajardo & King
2013), or, where that is too small for single precision, uniform over its area. Densities are per solid angle.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import drjit as dr
import numpy as np

from hagoromo.backend import Array3f, Bool, Float, arrays, clip, opaque_vector
from hagoromo.light.area_lamp import AreaLamp
from hagoromo.transport.path.scatter import frame_about

LEAST_SOLID_ANGLE = 0.02  # [sr] of a rectangle whose directions are drawn by the solid angle: its rounding is 1e-6
UPRIGHT = 1.0 - 1e-6


class LightSeen(NamedTuple):
    """A light in a direction from a point: whether it is there, its distance [m], and its density there [1/sr]."""

    there: Bool
    distance: Float
    density: Float


class LightDrawn(NamedTuple):
    """A direction to a light, the distance to it [m], and its density [1/sr]; 0: the point sees none of it."""

    to_lamp: Array3f
    distance: Float
    density: Float


class SphereLight:
    """A sphere that shines outwards. `radiance`, `share`, `drawn` and `seen` are what every area light has."""

    def __init__(self, lamp: AreaLamp) -> None:
        jit = arrays()
        self.centre, self.visible = opaque_vector(lamp.position), lamp.visible
        self.radius, self.radiance = (dr.opaque(jit.Float, float(x)) for x in (lamp.radius or 0.0, lamp.radiance))

    def share(self, point: Array3f) -> Float:
        """Irradiance that it gives on what faces it, without shadows; 0 within it."""
        squared = dr.squared_norm(self.centre - point)
        inside = squared <= self.radius * self.radius
        return dr.select(inside, 0.0, math.pi * self.radiance * self.radius * self.radius / squared)

    def drawn(self, point: Array3f, u: Float, v: Float) -> LightDrawn:
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


@dataclass
class _Local:
    """A rectangle from a point: its plane at depth `z` ≥ 0 in front of it (0: it sees the back), its sides between
    x0 … x1 and y0 … y1, and a bound of its solid angle [sr].
    """

    x0: Float
    x1: Float
    y0: Float
    y1: Float
    z: Float
    most: Float

    @property
    def wide(self) -> Bool:
        """Whether directions are drawn by the solid angle."""
        return self.most > LEAST_SOLID_ANGLE


class RectangleLight:
    """A rectangle that shines to one side; see `SphereLight`."""

    def __init__(self, lamp: AreaLamp) -> None:
        jit, edges = arrays(), lamp.edges
        assert edges is not None
        lengths = [float(length) for length in np.linalg.norm(edges, axis=1)]
        self.corner, self.visible = opaque_vector(lamp.position - 0.5 * edges.sum(axis=0)), lamp.visible
        self.axes = [opaque_vector(edge / length) for edge, length in zip(edges, lengths, strict=True)]
        self.normal, self.lengths = opaque_vector(lamp.normal), [dr.opaque(jit.Float, length) for length in lengths]
        self.area, self.radiance = (dr.opaque(jit.Float, float(x)) for x in (lamp.area, lamp.radiance))

    def share(self, point: Array3f) -> Float:
        """A bound of the irradiance that it gives on what faces it, without shadows; 0 behind it."""
        return self.radiance * self._from(point).most

    def drawn(self, point: Array3f, u: Float, v: Float) -> LightDrawn:
        """A direction by two uniform numbers."""
        here = self._from(point)
        solid, (first, last, b0, b1) = self._solid_angle(here)
        turn = u * (first - 2.0 * math.pi) + (u - 1.0) * last
        fu = (dr.cos(turn) * b0 - b1) / dr.sin(turn)
        cu = clip(dr.copysign(dr.rsqrt(fu * fu + b0 * b0), fu), -UPRIGHT, UPRIGHT)
        x = clip(cu * here.z * dr.rsqrt(1.0 - cu * cu), here.x0, here.x1)
        squared = x * x + here.z * here.z
        h0, h1 = (y * dr.rsqrt(squared + y * y) for y in (here.y0, here.y1))
        h = h0 + v * (h1 - h0)
        y = clip(h * dr.sqrt(squared) * dr.rsqrt(dr.fmax(1.0 - h * h, 1e-12)), here.y0, here.y1)
        x, y = (
            dr.select(here.wide, x, dr.lerp(here.x0, here.x1, u)),
            dr.select(here.wide, y, dr.lerp(here.y0, here.y1, v)),
        )
        away = x * self.axes[0] + y * self.axes[1] - here.z * self.normal
        distance = dr.norm(away)
        density = self._density(here, solid, distance)
        return LightDrawn(away / distance, distance, density)

    def seen(self, point: Array3f, direction: Array3f) -> LightSeen:
        """What is seen of it from a point in a unit direction."""
        here = self._from(point)
        facing = -dr.dot(direction, self.normal)
        distance = here.z / dr.fmax(facing, 1e-30)
        x, y = (distance * dr.dot(direction, axis) for axis in self.axes)
        there = (facing > 0.0) & (here.z > 0.0)
        there &= (x >= here.x0) & (x <= here.x1) & (y >= here.y0) & (y <= here.y1)
        density = self._density(here, self._solid_angle(here)[0], distance)
        return LightSeen(there, distance, dr.select(there, density, 0.0))

    def _from(self, point: Array3f) -> _Local:
        away = self.corner - point
        x, y = (dr.dot(away, axis) for axis in self.axes)
        z = dr.fmax(-dr.dot(away, self.normal), 0.0)
        x1, y1 = x + self.lengths[0], y + self.lengths[1]
        near = [clip(0.0 * z, low, high) for low, high in ((x, x1), (y, y1))]
        squared = dr.fmax(near[0] * near[0] + near[1] * near[1] + z * z, 1e-30)
        most = dr.fmin(self.area * z / (squared * dr.sqrt(squared)), 2.0 * math.pi)
        return _Local(x, x1, y, y1, z, most)

    def _density(self, here: _Local, solid: Float, distance: Float) -> Float:
        """Of directions to a place at a distance."""
        cosine = here.z / distance
        by_area = distance * distance / (self.area * dr.fmax(cosine, 1e-30))
        return dr.select(here.z > 0.0, dr.select(here.wide, dr.rcp(solid), by_area), 0.0)

    @staticmethod
    def _solid_angle(here: _Local) -> tuple[Float, tuple[Float, Float, Float, Float]]:
        """Solid angle [sr], and what a direction is drawn by: sums of its angles, and two components of normals."""
        kind, z = arrays().Array3f, -here.z
        corners = [
            kind(x, y, z) for x, y in ((here.x0, here.y0), (here.x1, here.y0), (here.x1, here.y1), (here.x0, here.y1))
        ]
        sides = [dr.normalize(dr.cross(one, corners[(k + 1) % 4])) for k, one in enumerate(corners)]
        angles = [_angle(-one, sides[(k + 1) % 4]) for k, one in enumerate(sides)]
        solid = dr.fmax(sum(angles) - 2.0 * math.pi, 1e-6)
        return solid, (angles[0] + angles[1], angles[2] + angles[3], sides[0].z, sides[2].z)


def _angle(one: Array3f, other: Array3f) -> Float:
    """Between two unit vectors, exact where it is small or near π."""
    half = 2.0 * dr.asin(dr.fmin(0.5 * dr.norm(one - other), 1.0))
    beyond = math.pi - 2.0 * dr.asin(dr.fmin(0.5 * dr.norm(one + other), 1.0))
    return dr.select(dr.dot(one, other) < 0.0, beyond, half)


def area_light(lamp: AreaLamp) -> SphereLight | RectangleLight:
    """The light of an area lamp, whose places count from the origin of its scene."""
    return RectangleLight(lamp) if lamp.radius is None else SphereLight(lamp)
