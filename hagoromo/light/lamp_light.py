"""Lamp light: a lamp without size as kernels read it."""

from __future__ import annotations

import math
from typing import NamedTuple

import drjit as dr

from hagoromo.backend import Array3f, Float, UInt, arrays, opaque_vector
from hagoromo.light.lamp import Lamp
from hagoromo.light.wide_light import LightDrawn, RayEnd


class LampInTurn(NamedTuple):
    """The number of a lamp that a loop in a kernel counts; near: whether its lamps are near ones, else all are far."""

    number: UInt
    near: bool


class LampLight:
    """Where a lamp is [m], or the direction to it; its intensity; and its beam, None where it shines alike all around.

    Whether it is near is a part of the kernel; all else is read from memory. See `LightOnDevice`.
    """

    radiance: Float = 0.0  # its irradiance counts in its place
    visible = False

    def __init__(self, lamp: Lamp, intensity: float) -> None:
        """`intensity`: in place of the lamp's own."""
        self.where, self.intensity = opaque_vector(lamp.place), dr.opaque(arrays().Float, intensity)
        self.near, self.beam = lamp.near, lamp.beam.on_device()

    def arriving(self, point: Array3f) -> tuple[Array3f, Float, Float]:
        """Unit direction to the lamp, the distance to it [m], and its irradiance on what faces it, without shadows."""
        to_lamp, distance, irradiance = self.where, math.inf, self.intensity
        if self.near:
            offset = self.where - point
            squared = dr.squared_norm(offset)
            inverse = dr.rsqrt(squared)
            to_lamp, distance, irradiance = offset * inverse, squared * inverse, self.intensity / squared
        return to_lamp, distance, irradiance if self.beam is None else irradiance * self.beam(to_lamp)

    def share(self, point: Array3f) -> Float:
        """The irradiance that it gives on what faces it, without shadows."""
        return self.arriving(point)[2]

    def drawn(self, point: Array3f, u: Float, v: Float, *further: Float) -> LightDrawn:
        """The direction to it."""
        to_lamp, distance, _ = self.arriving(point)
        return LightDrawn(to_lamp, arrays().Float(distance), None)

    def hit(self, origin: Array3f, direction: Array3f, end: RayEnd) -> None:
        """None: it has no size."""
