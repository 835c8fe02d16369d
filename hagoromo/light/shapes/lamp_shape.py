"""What a shape of area lamps is: its keys in files, its places, and the light that a walk draws from it.

A shape is one file of this folder and one line of `shapes.SHAPES`. March, full and path, scene files, Mitsuba and USD
know this protocol alone.
"""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import Array3f, Bool, Float
from hagoromo.files.record import Record
from hagoromo.light.wide_light import LightHit, LightOnDevice, RayEnd

Array = NDArray[np.float64]


class LightSeen(NamedTuple):
    """A light in a direction from a point: whether it is there, its distance [m], and its density there [1/sr]."""

    there: Bool
    distance: Float
    density: Float


class AreaLight(LightOnDevice, Protocol):
    """An area lamp on the device."""

    def seen(self, point: Array3f, direction: Array3f) -> LightSeen:
        """What is seen of it from a point in a unit direction; the density is that of `drawn`."""
        ...

    def hit(self, origin: Array3f, direction: Array3f, end: RayEnd) -> LightHit:
        """What rays meet of it before their end: it stands in front of what they hit, and hides nothing."""
        seen = self.seen(origin, direction)
        return LightHit(seen.there & (seen.distance < end.distance), seen.density, seen.distance)


class PointsOfShape(NamedTuple):
    """Places (n, 3) from the middle of the shape [m], and axes (n, 3) about which each shines as cosθ, with a like
    share of the light; None: alike in all directions, with the light that the shape has far away.
    """

    places: Array
    axes: Array | None


class LampShape(Record, frozen=True, kw_only=True):
    """Keys of a shape in a table [[area_lamp]], one field each. It shines alike from every place and into every
    direction (Lambert's law).
    """

    @property
    def word(self) -> str:
        """What people call it, such as "sphere": the name of its class."""
        return type(self).__name__.lower()

    @property
    def area(self) -> float:
        """Area that shines [m²]."""
        raise NotImplementedError

    @property
    def far_area(self) -> float:
        """Mean area that is seen from far away, over all directions [m²]: a quarter of one that is convex."""
        return 0.25 * self.area

    def checked(self, who: str) -> LampShape:
        """The shape; `InputError` when its numbers make none. who: the lamp, in messages."""
        return self

    def corners(self) -> Array:
        """(n, 3) places from its middle whose bounds hold it [m]."""
        raise NotImplementedError

    def turned_record(self, turn: Array) -> dict[str, Any]:
        """Those of its keys that a rotation (3, 3) of the world changes."""
        return {}

    def points(self, count: int) -> PointsOfShape:
        """`count` places that stand for it."""
        raise NotImplementedError

    def on_device(self, position: Array, radiance: float, visible: bool) -> AreaLight:
        """Its light, for walks; position (3,) [m] from the scene's origin."""
        raise NotImplementedError

    def mitsuba(self, position: Array) -> tuple[str, dict[str, Any]]:
        """The shape of Mitsuba, and its parameters."""
        raise NotImplementedError

    def usd(self) -> tuple[str, Array, dict[str, float]]:
        """The light of UsdLux, its axes as columns (3, 3), and its inputs."""
        raise NotImplementedError
