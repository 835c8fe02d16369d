"""What a beam is: how a near lamp shines in its directions, relative to the brightest of them.

A beam is one file of this folder and one line of `beams.BEAMS`. March, full and path, films, pages, Mitsuba, glTF and
USD know this protocol alone.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Hashable
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hagoromo.backend import Array3f, Float
from hagoromo.light.lamp_profile import LampProfile

Array = NDArray[np.float64]
FINE_DEG = 0.05  # steps in which the angle of half the intensity is looked for


class BeamOnDevice(Protocol):
    """Relative intensity of a lamp, 0…1."""

    def __call__(self, to_lamp: Array3f) -> Float:
        """At points that see the lamp in the unit direction `to_lamp` (world)."""
        ...


class BeamKeys(NamedTuple):
    """What a lamp says of its beam, see `Lamp`; axis: unit. A beam is chosen by those that are given."""

    axis: Array | None
    axis_power: float
    profile: LampProfile | None
    roll: float


class Cone(NamedTuple):
    """A beam that is even up to the angle `begins` from its axis and then falls linearly to nothing at `ends` [°]."""

    begins: float
    ends: float


class Beam(ABC):
    """The directions into which a near lamp shines.

    word: what people call it. axis: (3,) unit, world, where it is brightest or its table begins; None: it has none.
    focus: μ, where the beam is max(cosθ, 0)^μ about its axis; None: it is not.
    """

    word: str
    axis: Array | None = None
    focus: float | None = None

    @classmethod
    @abstractmethod
    def of(cls, keys: BeamKeys) -> Beam | None:
        """The beam of a lamp; None where its keys mean another one."""

    @property
    @abstractmethod
    def key(self) -> Hashable:
        """Equal for beams that are the same."""

    @abstractmethod
    def relative_intensity(self, directions: Array) -> Array:
        """Of unit `directions` (..., 3) away from the lamp, world: (...), 1 where it is brightest."""

    @abstractmethod
    def on_device(self) -> BeamOnDevice | None:
        """The same in kernels; None for a beam that is 1 everywhere, of which kernels hold no trace."""

    def record(self) -> dict[str, Any]:
        """Its keys in files, as plain values."""
        return {}

    def turned_record(self, turn: Array) -> dict[str, Any]:
        """Those of its keys that a rotation (3, 3) of the world changes."""
        return {}

    def cone(self) -> Cone | None:
        """The cone that it is exactly; None where it is none."""
        return None

    def half_angle(self) -> float:
        """Angle from the axis where it first is half as bright, towards C = 0 [rad]; π where it is nowhere."""
        angles = np.radians(np.arange(0.0, 180.0, FINE_DEG))
        assert self.axis is not None
        side = self.frame()[0]
        around = np.cos(angles)[:, None] * self.axis + np.sin(angles)[:, None] * side
        below = np.flatnonzero(self.relative_intensity(around) < 0.5)
        return float(angles[below[0]]) if below.size else math.pi

    def nearest_cone(self, widest: float) -> Cone:
        """A cone that is half as bright in its middle where the beam is; it ends at `widest` at most [°]."""
        half = math.degrees(self.half_angle())
        ends = min(2.0 * half, widest)
        return Cone(max(min(2.0 * half - ends, 0.99 * ends), 0.0), ends)

    def frame(self) -> Array:
        """See `Lamp.frame`."""
        assert self.axis is not None
        return frame_about(self.axis, 0.0)


def frame_about(axis: ArrayLike, roll: float) -> Array:
    """(3, 3): the directions of C = 0, C = 90° and γ = 0 of a beam about a unit `axis`, as rows; see `Lamp.frame`."""
    axis, down = np.asarray(axis, np.float64), np.array([0.0, 0.0, -1.0])
    turn = np.diag([1.0, -1.0, -1.0])
    if axis[2] < 1.0 - 1e-12:  # Rodrigues' rotation of −z to the axis, of sine w and cosine −axis z
        w = np.cross(down, axis)
        across = np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])
        turn = np.eye(3) + across + across @ across / (1.0 - axis[2])
    (c, s), (first, second) = (np.cos(roll), np.sin(roll)), turn.T[:2]
    return np.stack([c * first + s * second, c * second - s * first, axis])
