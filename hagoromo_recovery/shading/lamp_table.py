"""Lamp table: the lamps of all photographs on the device, of which each ray reads its own."""

from __future__ import annotations

from collections.abc import Sequence

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import Array3f, Float, UInt, arrays, lookup
from hagoromo.camera.response import white_of
from hagoromo.errors import InputError
from hagoromo.light.lamp import Lamp
from hagoromo.photograph.photograph import Photograph
from hagoromo_recovery.outline.lattice import Lattice

Array = NDArray[np.float64]
WIDTH = 12  # numbers of a lamp: place, whether near, strength of three channels, axis, exponent, what is behind it


class LampTable:
    """Lamps of photographs, `each` of every one; a photograph with fewer has some without strength.

    Places are counted in lattice coordinates, so that kernels compute in one frame.
    """

    def __init__(self, photographs: Sequence[Photograph], lattice: Lattice) -> None:
        self.each = max((len(photograph.lamps) for photograph in photographs), default=0)
        self.stated = np.zeros((len(photographs), self.each, WIDTH))
        for number, photograph in enumerate(photographs):
            for k, lamp in enumerate(photograph.lamps):
                self.stated[number, k] = _row(lamp, photograph, lattice)
        self.lattice = lattice
        self.voxel = dr.opaque(arrays().Float, lattice.voxel)
        self.move(np.zeros((len(photographs), self.each, 3)))

    @property
    def away(self) -> Array:
        """(photographs, each) distance of lamps from the middle of the lattice [m]; 1 of far ones."""
        places = self.lattice.to_world(self.stated[..., :3])
        distance = np.linalg.norm(places - self.lattice.middle, axis=2)
        return np.where(self.stated[..., 3] > 0.0, distance, 1.0)

    def move(self, shifts: Array) -> None:
        """Shift lamps (photographs, each, 3) from where they are stated: near ones [m], the direction of far ones."""
        rows = self.stated.copy()
        rows[..., :3] += np.where(rows[..., 3:4] > 0.0, shifts / self.lattice.voxel, shifts)
        self.rows = lookup(arrays().Float, rows.astype(np.float32).ravel())

    def arriving(self, photograph: UInt, lamp: int, place: Array3f) -> tuple[Array3f, Float, list[Float]]:
        """Unit direction to a lamp, the distance [voxel], and its irradiance in each channel on what faces it."""
        jit, row = arrays(), photograph * self.each + lamp

        def number(k: int) -> Float:
            return dr.gather(jit.Float, self.rows, row * WIDTH + k)

        where, near = jit.Array3f(number(0), number(1), number(2)), number(3)
        offset = where - place * near
        squared = dr.fmax(dr.squared_norm(offset), 1e-6)
        inverse = dr.rsqrt(squared)
        to_lamp = offset * inverse
        distance = dr.select(near > 0.0, squared * inverse, 1e6)
        metres = dr.select(near > 0.0, squared * (self.voxel * self.voxel), 1.0)
        cosine = -dr.dot(to_lamp, jit.Array3f(number(7), number(8), number(9)))
        beam = dr.select(cosine > 0.0, dr.power(dr.fmax(cosine, 1e-30), number(10)), number(11))
        return to_lamp, distance, [number(4 + c) * beam / metres for c in range(3)]


def _row(lamp: Lamp, photograph: Photograph, lattice: Lattice) -> Array:
    """The numbers of a lamp. `InputError` for a lamp with a profile."""
    beam = lamp.beam.record()
    if lamp.profile is not None:
        raise InputError(
            f"lamp {lamp.name!r} has a profile: recover takes lamps that shine alike all around, or about an axis "
            "(axis_power); give the nearest axis_power"
        )
    response, count = photograph.camera.response, photograph.values.shape[2]
    white = white_of(lamp.spectrum, response, count)
    place = lattice.from_world(lamp.place[None])[0] if lamp.near else lamp.place
    power = float(beam.get("axis_power", 0.0))
    axis = np.asarray(beam.get("axis", (0.0, 0.0, 0.0)), float)
    strength = np.asarray(lamp.intensity, float) * white
    behind = 1.0 if power == 0.0 else 0.0
    return np.concatenate([place, [float(lamp.near)], np.broadcast_to(strength, (3,)), axis, [power, behind]])
