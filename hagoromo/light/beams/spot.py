"""Spot: the beam of a lamp that is brightest about an axis, such as a bare LED."""

from __future__ import annotations

import math
from typing import Any

import drjit as dr
import numpy as np

from hagoromo.backend import Array3f, Float, arrays, opaque_vector
from hagoromo.light.beams.beam import Array, Beam, BeamKeys

WIDEST_FOCUS = 0.05  # exponent below which a spot is half as bright at right angles to its axis, nearly


class SpotBeam(Beam):
    """max(cosθ, 0)^μ, θ the angle from the axis (3,) unit, world."""

    word = "spot"

    def __init__(self, axis: Array, focus: float) -> None:
        self.axis: Array = axis  # pyrefly: ignore[bad-override-mutable-attribute]
        self.focus: float = focus  # pyrefly: ignore[bad-override-mutable-attribute]

    @classmethod
    def of(cls, keys: BeamKeys) -> SpotBeam | None:
        """Of a lamp with an axis and no profile."""
        return None if keys.axis is None or keys.profile is not None else cls(keys.axis, keys.axis_power)

    @property
    def key(self) -> tuple[object, ...]:
        """Axis and exponent."""
        return self.word, self.axis.tobytes(), self.focus

    def relative_intensity(self, directions: Array) -> Array:
        """See `Beam`."""
        return np.maximum(directions @ self.axis, 0.0) ** self.focus

    def on_device(self) -> SpotOnDevice:
        """See `Beam`."""
        return SpotOnDevice(self.axis, self.focus)

    def record(self) -> dict[str, Any]:
        """See `Beam`."""
        return {"axis": self.axis.tolist(), "axis_power": self.focus}

    def turned_record(self, turn: Array) -> dict[str, Any]:
        """See `Beam`."""
        return {"axis": (turn @ self.axis).tolist()}

    def half_angle(self) -> float:
        """cos^μ θ = ½."""
        return math.acos(0.5 ** (1.0 / max(self.focus, WIDEST_FOCUS)))


class SpotOnDevice:
    """See `SpotBeam`."""

    def __init__(self, axis: Array, power: float) -> None:
        jit = arrays()
        self.axis, self.power = opaque_vector(axis), dr.opaque(jit.Float, power)
        self.behind = dr.opaque(jit.Float, 0.0**power)  # as in `SpotBeam`: with μ = 0 it shines alike all around

    def __call__(self, to_lamp: Array3f) -> Float:
        """See `BeamOnDevice`."""
        cosine = -dr.dot(to_lamp, self.axis)
        return dr.select(cosine > 0.0, dr.power(dr.fmax(cosine, 1e-30), self.power), self.behind)
