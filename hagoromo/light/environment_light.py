"""Environment light: directions drawn by the light that comes from each pixel of a map.

A pixel is a patch of constant radiance: it is drawn by its share of the light of all parts, and a direction uniformly
within it. So the radiance over the density is nearly one number, whatever the direction.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import Array3f, Float, UInt, arrays, check_entries, lookup, opaque_vector
from hagoromo.light.wide_light import LightDrawn, LightHit, RayEnd, interval_of, shares_before

Array = NDArray[np.floating]


class EnvironmentLight:
    """A map on the device: cumulative shares of its rows and of the pixels in each, and the radiance of its parts."""

    def __init__(self, parts: Sequence[Array], solid: Array, rotation: Array, visible: bool) -> None:
        """`parts`: radiance of each pixel (height, width), of each part. `solid`: angle of a pixel of each row [sr].
        `rotation`: (3, 3) from the map into the world.
        """
        jit = arrays()
        height, width = parts[0].shape
        check_entries(height * (width + 1), "the pixels of the environment")
        light = sum(part.astype(np.float64) for part in parts) * solid[:, None]
        self.radiance: Float = 1.0  # no array: one that lives on would make each kernel another
        self.visible, self.flux = visible, dr.opaque(jit.Float, float(light.sum()))
        rows, columns = shares_before(light.sum(axis=1)), shares_before(light)
        # the density is that of the shares as they are rounded
        chance = np.diff(rows)[:, None].astype(np.float64) * np.diff(columns, axis=1)
        self.density = lookup(jit.Float, (chance / solid[:, None]).astype(np.float32))
        self.rows, self.columns = lookup(jit.Float, rows), lookup(jit.Float, columns)
        self.of_parts = [lookup(jit.Float, part) for part in parts]
        self.size = height, width
        self.height, self.width = dr.opaque(jit.UInt, height), dr.opaque(jit.UInt, width)
        self.axes = [opaque_vector(axis) for axis in rotation.T]  # of the map, in the world
        dr.eval(self.density, self.rows, self.columns, self.of_parts)

    def share(self, point: Array3f) -> Float:
        """Irradiance that it gives on what faces its light, about: half of what comes from all around."""
        return 0.5 * self.flux

    def drawn(self, point: Array3f, u: Float, v: Float, *further: Float) -> LightDrawn:
        """A direction by four uniform numbers; the last two are the place in a pixel, across and down."""
        across, down = further
        way, pixel = self.direction(u, v, across, down)
        distance = dr.full(arrays().Float, dr.inf, dr.width(u))
        return LightDrawn(way, distance, self.density_of(pixel), self.radiance_of(pixel))

    def hit(self, origin: Array3f, direction: Array3f, end: RayEnd) -> LightHit:
        """What rays that end nowhere meet."""
        pixel = self.pixel(direction)
        return LightHit(dr.isinf(end.distance), self.density_of(pixel), tints=self.radiance_of(pixel))

    def direction(self, u: Float, v: Float, across: Float, down: Float) -> tuple[Array3f, UInt]:
        """A unit direction by four uniform numbers, and the number of its pixel."""
        row = interval_of(self.rows, self.size[0], u, arrays().UInt(0))
        column = interval_of(self.columns, self.size[1], v, row * (self.width + 1))
        pixel = row * self.width + column
        north = row * 2 < self.height  # the southern half is mirrored: near each pole places are exact
        mirrored = dr.select(north, row, self.height - 1 - row)
        first, last = self._falls(mirrored)
        fall = dr.lerp(first, last, down)  # sin² of half the angle from the pole: uniform in solid angle
        z, aside = 1.0 - 2.0 * fall, 2.0 * dr.sqrt(dr.fmax(fall * (1.0 - fall), 0.0))
        azimuth = math.pi - 2.0 * math.pi * (arrays().Float(column) + across) / arrays().Float(self.width)
        sine, cosine = dr.sincos(azimuth)
        x, y, z = aside * cosine, aside * sine, dr.select(north, z, -z)
        way = x * self.axes[0] + y * self.axes[1] + z * self.axes[2]
        return dr.normalize(way), pixel

    def pixel(self, direction: Array3f) -> UInt:
        """The number of the pixel in a unit direction."""
        jit = arrays()
        x, y, z = (dr.dot(direction, axis) for axis in self.axes)
        polar = dr.atan2(dr.sqrt(x * x + y * y), z)
        row = polar * (jit.Float(self.height) / math.pi)
        column = (math.pi - dr.atan2(y, x)) * (jit.Float(self.width) / (2.0 * math.pi))
        row, column = (jit.UInt(dr.fmax(value, 0.0)) for value in (row, column))
        return dr.minimum(row, self.height - 1) * self.width + dr.minimum(column, self.width - 1)

    def density_of(self, pixel: UInt) -> Float:
        """Density of the directions of a pixel [1/sr]."""
        return dr.gather(arrays().Float, self.density, pixel)

    def radiance_of(self, pixel: UInt) -> list[Float]:
        """Radiance of every part."""
        return [dr.gather(arrays().Float, values, pixel) for values in self.of_parts]

    def _falls(self, row: UInt) -> tuple[Float, Float]:
        """sin² of half the angle from the pole at both sides of a row of its half of the map."""
        half = 0.5 * math.pi / arrays().Float(self.height)
        first, last = (dr.sin(arrays().Float(row + k) * half) for k in (0, 1))
        return first * first, last * last
