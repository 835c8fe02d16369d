"""Profile: the beam of a luminaire as it was measured, an IES table over the angles C and γ."""

from __future__ import annotations

import math
from typing import Any

import drjit as dr
import numpy as np

from hagoromo.backend import Array3f, Float, UInt, arrays, lookup, opaque_vector
from hagoromo.light.beams.beam import Array, Beam, BeamKeys, Cone, frame_about
from hagoromo.light.lamp_profile import LampProfile

CELLS_PER_KNOT = 2  # of the table that finds the interval of an angle, per shortest interval


class ProfileBeam(Beam):
    """A measured table; axis: (3,) unit, world, its γ = 0. roll: turn of C = 0 about the axis [rad]."""

    word = "profile"

    def __init__(self, profile: LampProfile, axis: Array, roll: float) -> None:
        self.profile, self.roll = profile, roll
        self.axis: Array = axis  # pyrefly: ignore[bad-override-mutable-attribute]

    @classmethod
    def of(cls, keys: BeamKeys) -> ProfileBeam | None:
        """Of a lamp with a profile, whose axis is then known."""
        return None if keys.profile is None or keys.axis is None else cls(keys.profile, keys.axis, keys.roll)

    @property
    def key(self) -> tuple[object, ...]:
        """The table itself, its axis and roll."""
        return self.word, id(self.profile), self.axis.tobytes(), self.roll

    def relative_intensity(self, directions: Array) -> Array:
        """See `Beam`."""
        return self.profile.towards(directions, self.frame())

    def on_device(self) -> ProfileOnDevice:
        """See `Beam`."""
        return ProfileOnDevice(self.profile, self.frame())

    def frame(self) -> Array:
        """See `Beam`."""
        return frame_about(self.axis, self.roll)

    def record(self) -> dict[str, Any]:
        """See `Beam`."""
        return {
            "axis": self.axis.tolist(), "roll_deg": math.degrees(self.roll), "profile": self.profile.record(),
        }  # fmt: skip

    def turned_record(self, turn: Array) -> dict[str, Any]:
        """Its frame turns as a whole: C = 0 is where it was turned to."""
        axis = turn @ self.axis
        first, second, _ = frame_about(axis / np.linalg.norm(axis), 0.0)
        towards = turn @ self.frame()[0]
        return {
            "axis": axis.tolist(), "roll_deg": float(np.degrees(np.arctan2(towards @ second, towards @ first))),
        }  # fmt: skip

    def cone(self) -> Cone | None:
        """Of a table that is 1 and then falls linearly to 0, alike all around."""
        angles, values = self.profile.vertical, self.profile.intensity
        one = np.array([1.0, 1.0, 0.0] if len(angles) == 3 else [1.0, 0.0])
        if len(angles) not in (2, 3) or angles[0] != 0.0 or not (values == one).all():
            return None
        return Cone(float(angles[-2]), float(angles[-1]))


class ProfileOnDevice:
    """Bilinear look-up of a profile over C and γ: 0 at γ that it does not cover."""

    def __init__(self, profile: LampProfile, frame: np.ndarray) -> None:
        """`frame`: (3, 3), the directions of C = 0, C = 90° and γ = 0 as rows, world."""
        jit = arrays()
        self.frame = tuple(map(opaque_vector, frame))
        self.lateral, self.vertical = AngleIntervals(profile.lateral), AngleIntervals(profile.vertical)
        i = profile.intensity
        cells = np.stack([i[:-1, :-1], i[:-1, 1:], i[1:, :-1], i[1:, 1:]], axis=-1)  # (C, γ) of each corner
        self.cells = lookup(jit.Float, cells.astype(np.float32))
        self.across = dr.opaque(jit.UInt, cells.shape[1])
        least, most = np.radians(profile.vertical[[0, -1]]) + np.array([-1e-6, 1e-6])  # rounding of the angle
        self.least, self.most = dr.opaque(jit.Float, float(least)), dr.opaque(jit.Float, float(most))

    def __call__(self, to_lamp: Array3f) -> Float:
        """See `BeamOnDevice`."""
        jit = arrays()
        x, y, z = (-dr.dot(to_lamp, axis) for axis in self.frame)
        aside = dr.sqrt(dr.fma(x, x, y * y))
        gamma = dr.atan2(aside, z)  # exact near the axis, where an arc cosine is not
        azimuth = dr.atan2(y, x)
        azimuth = dr.select(azimuth < 0.0, azimuth + 2.0 * math.pi, azimuth)
        (plane, across), (ring, along) = self.lateral.find(azimuth), self.vertical.find(gamma)
        corners = dr.gather(jit.Array4f, self.cells, dr.fma(plane, self.across, ring))
        first = dr.lerp(corners[0], corners[1], along)
        value = dr.lerp(first, dr.lerp(corners[2], corners[3], along), across)
        return dr.select((gamma >= self.least) & (gamma <= self.most), value, 0.0)


class AngleIntervals:
    """Knots of a table over an angle, any distances apart, and the interval that an angle lies in.

    The range is cut into cells shorter than the shortest interval: each holds one knot at most, so that the interval is
    that of the cell's start or the next one.
    """

    def __init__(self, knots_deg: np.ndarray) -> None:
        jit, knots = arrays(), np.radians(knots_deg)
        widths = np.diff(knots)
        count = math.ceil(CELLS_PER_KNOT * (knots[-1] - knots[0]) / widths.min())
        starts = knots[0] + (knots[-1] - knots[0]) * np.arange(count) / count
        interval = np.clip(np.searchsorted(knots, starts, side="right") - 1, 0, len(widths) - 1)
        self.of_cell = lookup(jit.UInt, interval.astype(np.uint32))
        self.start, self.last_cell, self.last = (
            dr.opaque(jit.Float, float(knots[0])), dr.opaque(jit.UInt, count - 1), dr.opaque(jit.UInt, len(widths) - 1),
        )  # fmt: skip
        self.per_radian = dr.opaque(jit.Float, count / float(knots[-1] - knots[0]))
        self.intervals = lookup(jit.Float, np.stack([knots[:-1], 1.0 / widths], axis=-1).astype(np.float32))

    def find(self, angle: Float) -> tuple[UInt, Float]:
        """Number of the interval of `angle` [rad], and the place in it, 0…1."""
        jit = arrays()
        cell = dr.minimum(jit.UInt(dr.fmax((angle - self.start) * self.per_radian, 0.0)), self.last_cell)
        interval = dr.gather(jit.UInt, self.of_cell, cell)
        beyond = self._place(interval, angle) >= 1.0
        interval = dr.select(beyond & (interval < self.last), interval + 1, interval)
        return interval, dr.fmin(dr.fmax(self._place(interval, angle), 0.0), 1.0)

    def _place(self, interval: UInt, angle: Float) -> Float:
        start, inverse = dr.gather(arrays().Array2f, self.intervals, interval)
        return (angle - start) * inverse
