"""Emission: the intensity of a spot or of a lamp with a profile towards a point, relative to its brightest direction.

A lamp that shines alike all around has none: its kernels hold no trace of it.
"""

from __future__ import annotations

import math
from typing import Protocol

import drjit as dr
import numpy as np

from hagoromo.backend import Array3f, Float, UInt, arrays, lookup, opaque_vector
from hagoromo.light.lamp import Lamp
from hagoromo.light.lamp_profile import LampProfile

CELLS_PER_KNOT = 2  # of the table that finds the interval of an angle, per shortest interval


class Emission(Protocol):
    """Relative intensity of a lamp, 0…1."""

    def __call__(self, to_lamp: Array3f) -> Float:
        """At points that see the lamp in the unit direction `to_lamp` (world)."""
        ...


def emission_of(lamp: Lamp) -> Emission | None:
    """The emission of a lamp; None where it shines alike all around, or is far."""
    if lamp.profile is not None:
        return ProfileEmission(lamp.profile, lamp.frame)
    return None if lamp.axis is None else SpotEmission(lamp.axis, lamp.axis_power)


class SpotEmission:
    """max(cosθ, 0)^u, θ the angle from the axis."""

    def __init__(self, axis: np.ndarray, power: float) -> None:
        jit = arrays()
        self.axis, self.power = opaque_vector(axis), dr.opaque(jit.Float, power)
        self.behind = dr.opaque(jit.Float, 0.0**power)  # as in `Lamp`: with u = 0 it shines alike all around

    def __call__(self, to_lamp: Array3f) -> Float:
        """See `Emission`."""
        cosine = -dr.dot(to_lamp, self.axis)
        return dr.select(cosine > 0.0, dr.power(dr.fmax(cosine, 1e-30), self.power), self.behind)


class ProfileEmission:
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
        """See `Emission`."""
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
