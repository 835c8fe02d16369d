"""Tube: an area lamp that shines from its side, such as a straight fluorescent or LED tube; its ends are dark."""

from __future__ import annotations

import math
from typing import Annotated, Any, NamedTuple

import drjit as dr
import numpy as np

from hagoromo.backend import Array3f, Bool, Float, arrays, clip, opaque_vector
from hagoromo.directions import GOLDEN
from hagoromo.errors import InputError
from hagoromo.files.record import Positive, Vector, about
from hagoromo.light.shapes.lamp_shape import AreaLight, Array, LampShape, LightSeen, PointsOfShape
from hagoromo.light.wide_light import LightDrawn

LEAST_LENGTH = 1e-9  # of a tube, over its radius
FLAT = 1e-12  # square of the sine to the axis below which a ray misses


class Tube(LampShape, frozen=True, kw_only=True):
    """A tube about the place of the lamp."""

    radius: Annotated[Positive, about("radius of a tube [m]")]
    along: Annotated[Vector, about("with radius: a tube, from end to end [m]; it shines from its side")]

    @property
    def length(self) -> float:
        """From end to end [m]."""
        return float(np.linalg.norm(self.along))

    @property
    def axes(self) -> Array:
        """Three unit vectors as columns; the first goes along it."""
        axis = np.array(self.along) / self.length
        side = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
        side /= np.linalg.norm(side)
        return np.asarray(np.column_stack([axis, side, np.cross(axis, side)]), np.float64)

    @property
    def area(self) -> float:
        """Of its side."""
        return 2.0 * math.pi * self.radius * self.length

    def checked(self, who: str) -> Tube:
        """`InputError` for a tube without a length."""
        if self.length > LEAST_LENGTH * self.radius:
            return self
        raise InputError(f"{who}: along is {self.length:.3g} m long: give the way from one end to the other")

    def corners(self) -> Array:
        """Eight corners of a bar around it."""
        ends = np.array([-0.5, 0.5])[:, None] * self.along
        square = np.array([(1, 1), (1, -1), (-1, 1), (-1, -1)]) @ (self.radius * self.axes[:, 1:].T)
        return (ends[:, None] + square).reshape(-1, 3)

    def turned_record(self, turn: Array) -> dict[str, Any]:
        """Its direction and length."""
        return {"along": (turn @ np.array(self.along)).tolist()}

    def points(self, count: int) -> PointsOfShape:
        """Its middle, or places along it on its side, each turned by the golden angle from the last."""
        if count == 1:
            return PointsOfShape(np.zeros((1, 3)), None)
        share, turn = (np.arange(count) + 0.5) / count - 0.5, GOLDEN * np.arange(count)
        outwards = np.stack([np.cos(turn), np.sin(turn)], axis=1) @ self.axes[:, 1:].T
        return PointsOfShape(np.outer(share, self.along) + self.radius * outwards, outwards)

    def on_device(self, position: Array, radiance: float, visible: bool) -> TubeLight:
        """See `LampShape`."""
        return TubeLight(self, position, radiance, visible)

    def mitsuba(self, position: Array) -> tuple[str, dict[str, Any]]:
        """See `LampShape`."""
        half = 0.5 * np.array(self.along)
        return "cylinder", {"p0": position - half, "p1": position + half, "radius": self.radius}

    def usd(self) -> tuple[str, Array, dict[str, float]]:
        """UsdLux has it along +x."""
        return "CylinderLight", self.axes, {"radius": self.radius, "length": self.length}


class _Near(NamedTuple):
    """A tube from a point: across to its axis, distance of that, where its middle is along it [m], angles from the
    point to its ends, and half the angle of its side that the point sees, about the axis; 0 within it.
    """

    across: Array3f
    distance: Float
    middle: Float
    first: Float
    last: Float
    arc: Float


class TubeLight(AreaLight):
    """The side of a tube. A place along it is drawn by equal angles from the point (Kulla & Fajardo 2012), then one
    around it, uniform over the arc that the point sees.
    """

    def __init__(self, shape: Tube, position: Array, radiance: float, visible: bool) -> None:
        jit = arrays()
        self.centre, self.axis, self.visible = opaque_vector(position), opaque_vector(shape.axes[:, 0]), visible
        numbers = shape.radius, 0.5 * shape.length, radiance
        self.radius, self.half, self.radiance = (dr.opaque(jit.Float, float(x)) for x in numbers)

    def share(self, point: Array3f) -> Float:
        """About the irradiance that it gives on what faces it, without shadows; 0 within it."""
        near = self._from(point)
        seen = 2.0 * self.radius / near.distance * (dr.sin(near.last) - dr.sin(near.first))
        return dr.select(near.arc > 0.0, self.radiance * dr.fmin(seen, math.pi), 0.0)

    def drawn(self, point: Array3f, u: Float, v: Float, *further: Float) -> LightDrawn:
        """A direction by two uniform numbers."""
        near = self._from(point)
        along = near.distance * dr.tan(dr.lerp(near.first, near.last, u))
        to_point = -near.across / near.distance
        sine, cosine = dr.sincos(near.arc * (2.0 * v - 1.0))
        normal = to_point * cosine + dr.cross(self.axis, to_point) * sine
        away = near.across + self.axis * along + normal * self.radius
        distance = dr.norm(away)
        way = away / distance
        return LightDrawn(way, distance, self._density(near, along, distance, -dr.dot(way, normal)))

    def seen(self, point: Array3f, direction: Array3f) -> LightSeen:
        """What is seen of it from a point in a unit direction."""
        near = self._from(point)
        way = direction - self.axis * dr.dot(direction, self.axis)
        flat = dr.squared_norm(way)
        to_nearest = dr.dot(near.across, way) / dr.fmax(flat, FLAT)
        missed = near.across - way * to_nearest  # from the ray to the axis, where it is nearest
        inner = self.radius * self.radius - dr.squared_norm(missed)
        distance = to_nearest - dr.sqrt(dr.fmax(inner, 0.0) / dr.fmax(flat, FLAT))
        along = distance * dr.dot(direction, self.axis)
        there = (flat > FLAT) & (inner > 0.0) & (to_nearest > 0.0) & (near.arc > 0.0)
        there &= dr.abs(along - near.middle) < self.half
        normal = (way * distance - near.across) / self.radius
        density = self._density(near, along, distance, -dr.dot(direction, normal))
        return LightSeen(there, distance, dr.select(there, density, 0.0))

    def _from(self, point: Array3f) -> _Near:
        away = self.centre - point
        middle = dr.dot(away, self.axis)
        across = away - self.axis * middle
        distance = dr.fmax(dr.norm(across), 1e-12)
        first, last = (dr.atan2(middle + end, distance) for end in (-self.half, self.half))
        ratio = self.radius / distance
        arc = dr.select(ratio < 1.0, dr.acos(clip(ratio, 0.0, 1.0)), 0.0)
        return _Near(across, distance, middle, first, last, arc)

    def _density(self, near: _Near, along: Float, distance: Float, cosine: Float) -> Float:
        """Of directions to a place of the side; cosine: there, of the way to the point to the normal."""
        by_length = near.distance / ((near.last - near.first) * (near.distance * near.distance + along * along))
        by_area = by_length / (2.0 * near.arc * self.radius)
        found: Bool = (near.arc > 0.0) & (cosine > 0.0)
        return dr.select(found, by_area * distance * distance / dr.fmax(cosine, 1e-30), 0.0)
