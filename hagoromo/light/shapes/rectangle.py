"""Rectangle: an area lamp that shines to one side, such as a window or a soft box."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Any

import drjit as dr
import numpy as np

from hagoromo.backend import Array3f, Bool, Float, arrays, clip, opaque_vector
from hagoromo.errors import InputError
from hagoromo.files.record import Vector, about
from hagoromo.light.shapes.lamp_shape import AreaLight, Array, LampShape, LightSeen, PointsOfShape
from hagoromo.light.wide_light import LightDrawn

SQUARE = 1e-6  # cosine of the angle between the sides, at most
LEAST_SIDE = 1e-9  # of a rectangle, over the other one
LEAST_SOLID_ANGLE = 0.02  # [sr] of a rectangle whose directions are drawn by the solid angle: its rounding is 1e-6
UPRIGHT = 1.0 - 1e-6


class Rectangle(LampShape, frozen=True, kw_only=True):
    """A rectangle about the place of the lamp."""

    edges: Annotated[
        tuple[Vector, Vector],
        about("two sides of a rectangle as vectors at right angles [m]; it shines to the side of their cross product"),
    ]

    @property
    def sides(self) -> Array:
        """(2, 3) [m]."""
        return np.array(self.edges)

    @property
    def normal(self) -> Array:
        """(3,) unit: the direction into which it shines."""
        normal = np.cross(*self.sides)
        return normal / np.linalg.norm(normal)

    @property
    def area(self) -> float:
        """Of its front."""
        return float(np.linalg.norm(np.cross(*self.sides)))

    def checked(self, who: str) -> Rectangle:
        """`InputError` for sides without a length, or at no right angle."""
        lengths = np.linalg.norm(self.sides, axis=1)
        if not (lengths.min() > LEAST_SIDE * lengths.max() and np.isfinite(lengths).all()):
            raise InputError(
                f"{who}: edges are {lengths[0]:.3g} m and {lengths[1]:.3g} m long: give two sides with a length"
            )
        if not abs(self.sides[0] @ self.sides[1]) <= SQUARE * lengths.prod():
            raise InputError(
                f"{who}: edges {self.sides.tolist()} are not at right angles: give the sides of a rectangle"
            )
        return self

    def corners(self) -> Array:
        """Its four corners."""
        return 0.5 * np.array([(1, 1), (1, -1), (-1, 1), (-1, -1)]) @ self.sides

    def turned_record(self, turn: Array) -> dict[str, Any]:
        """Its sides."""
        return {"edges": (self.sides @ turn.T).tolist()}

    def points(self, count: int) -> PointsOfShape:
        """The middles of equal parts, nearly square."""
        first, second = np.linalg.norm(self.sides, axis=1)
        across = 2 ** min(max(round(0.5 * math.log2(count * first / second)), 0), round(math.log2(count)))
        shares = np.stack(np.meshgrid(*((np.arange(n) + 0.5) / n - 0.5 for n in (across, count // across))), axis=-1)
        return PointsOfShape(shares.reshape(-1, 2) @ self.sides, np.tile(self.normal, (count, 1)))

    def on_device(self, position: Array, radiance: float, visible: bool) -> RectangleLight:
        """See `LampShape`."""
        return RectangleLight(self, position, radiance, visible)

    def mitsuba(self, position: Array) -> tuple[str, dict[str, Any]]:
        """See `LampShape`."""
        pose = np.eye(4)
        pose[:3, :3] = np.column_stack([0.5 * self.sides[0], 0.5 * self.sides[1], self.normal])
        pose[:3, 3] = position
        return "rectangle", {"to_world": pose}

    def usd(self) -> tuple[str, Array, dict[str, float]]:
        """See `LampShape`."""
        first, second = np.linalg.norm(self.sides, axis=1)
        axes = np.column_stack([self.sides[1] / second, self.sides[0] / first, -self.normal])
        return "RectLight", axes, {"width": float(second), "height": float(first)}


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


class RectangleLight(AreaLight):
    """A rectangle that shines to one side. Directions are uniform within its spherical rectangle (Ureña, Fajardo & King
    2013), or, where that is too small for single precision, uniform over its area.
    """

    def __init__(self, shape: Rectangle, position: Array, radiance: float, visible: bool) -> None:
        jit, edges = arrays(), np.array(shape.edges)
        lengths = [float(length) for length in np.linalg.norm(edges, axis=1)]
        self.corner, self.visible = opaque_vector(position - 0.5 * edges.sum(axis=0)), visible
        self.axes = [opaque_vector(edge / length) for edge, length in zip(edges, lengths, strict=True)]
        self.normal, self.lengths = opaque_vector(shape.normal), [dr.opaque(jit.Float, length) for length in lengths]
        self.area, self.radiance = (dr.opaque(jit.Float, float(x)) for x in (shape.area, radiance))

    def share(self, point: Array3f) -> Float:
        """A bound of the irradiance that it gives on what faces it, without shadows; 0 behind it."""
        return self.radiance * self._from(point).most

    def drawn(self, point: Array3f, u: Float, v: Float, *further: Float) -> LightDrawn:
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
