"""Lattice field: the numbers of one field of a lattice, read part by part, so that a file is written in little memory.

A part is a box of voxels (z, y, x) from `low` to before `high`, which does not reach beyond the lattice.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.light.colour import linear_colour
from hagoromo.light.spectrum import Spectrum
from hagoromo.volume.box import VolumeBox
from hagoromo.volume.table import BLOCK
from hagoromo.volume.voxels import BRICK, STORED, unpacked_axis, unpacked_density

Field = Literal["density", "axis", "colour"]
BRICKS_AT_ONCE = 1 << 11  # that are read together
VOXELS_AT_ONCE = 1 << 21  # of a slab
Place = Sequence[int]


class LatticeField(Protocol):
    """shape: (nz, ny, nx[, components])."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Voxels along z, y and x, and components."""
        ...

    def part(self, low: Place, high: Place) -> NDArray[Any]:
        """The numbers of a part, C-contiguous."""
        ...


@dataclass(frozen=True, eq=False)
class ArrayField:
    """A field that is in memory."""

    values: NDArray[Any]

    @property
    def shape(self) -> tuple[int, ...]:
        """That of the array."""
        return self.values.shape

    def part(self, low: Place, high: Place) -> NDArray[Any]:
        """A copy of a part."""
        return np.ascontiguousarray(self.values[tuple(map(slice, low, high))])


@dataclass(frozen=True, eq=False)
class BoxField:
    """A field of a volume box: density; axis, in the axes of the box; or the body's linear sRGB under D65.

    Float32, 0 without matter. `InputError` for a box of texels.
    """

    box: VolumeBox
    field: Field

    def __post_init__(self) -> None:
        if self.box.texel:
            raise InputError(f"volume box {self.box.name!r} is a shell of texels: its voxels are no lattice of space")

    @property
    def shape(self) -> tuple[int, ...]:
        """Of the lattice of the box; three components but for the density."""
        return self.box.bricks.shape if self.field == "density" else (*self.box.bricks.shape, 3)

    def part(self, low: Place, high: Place) -> NDArray[np.float32]:
        """The numbers of a part, from the bricks that reach into it."""
        first = np.maximum(np.floor_divide(low, BRICK) - 1, 0)  # the last layer of a brick is the first of the next
        end = -(-np.array(high) // BRICK)
        full = np.zeros((*(BRICK * (end - first) + 1), *self.shape[3:]), np.float32)
        numbers, places = self._bricks(first, end)
        for begin in range(0, len(numbers), BRICKS_AT_ONCE):
            some = slice(begin, begin + BRICKS_AT_ONCE)
            for values, (z, y, x) in zip(self._voxels(numbers[some]), (places[some] - first) * BRICK, strict=True):
                full[z : z + STORED, y : y + STORED, x : x + STORED] = values
        inner = (slice(a - BRICK * f, b - BRICK * f) for a, b, f in zip(low, high, first, strict=True))
        return np.ascontiguousarray(full[tuple(inner)])

    def _bricks(self, first: NDArray[np.int64], end: NDArray[np.int64]) -> tuple[NDArray, NDArray]:
        """Numbers and places of the stored bricks from place `first` to before `end`, in their order."""
        bricks = self.box.bricks
        blocks = bricks.table.coarse[tuple(slice(a // BLOCK, -(-b // BLOCK)) for a, b in zip(first, end, strict=True))]
        numbers = bricks.table.fine[np.sort(blocks[blocks >= 0])].ravel()
        numbers = numbers[numbers >= 0]
        places = bricks.places[numbers]
        inside = ((places >= first) & (places < end)).all(axis=1)
        return numbers[inside], places[inside]

    def _voxels(self, numbers: NDArray) -> NDArray[np.float32]:
        """Of some bricks, by number (n,): (n, 9, 9, 9[, 3])."""
        bricks, which = self.box.bricks, numbers.astype(np.uint32)
        if self.field == "axis":
            return unpacked_axis(np.array(bricks.axis.of(which))).astype(np.float32)
        density = unpacked_density(np.array(bricks.density.of(which)))
        if self.field == "density":
            return density.astype(np.float32)
        return np.where(density[..., None] > 0, self._colours(which), 0.0).astype(np.float32)

    def _colours(self, which: NDArray[np.uint32]) -> NDArray[np.float64]:
        """π α times the linear sRGB of the body of each voxel of some bricks: (n, 9, 9, 9, 3)."""
        box, light = self.box, Spectrum.named("D65")
        lattice, material = (len(which), STORED, STORED, STORED), np.uint8(0)
        if box.bricks.material is not None:
            material = np.array(box.bricks.material.of(which)).reshape(lattice)
        alpha = np.array([material.alpha for material in box.materials])[material][..., None]
        if box.bricks.colour is None:
            return np.pi * alpha * np.array([linear_colour(m.body_colour, light) for m in box.materials])[material]
        basis = np.array([linear_colour(each, light) for each in box.basis or (Spectrum.constant(1.0),)])
        colour = np.array(box.bricks.colour.of(which)).reshape(*lattice, 4)[..., : len(basis)]
        return np.pi * alpha * (colour.astype(float) @ basis)


def lattice_field(values: NDArray[Any] | LatticeField) -> LatticeField:
    """An array, or a field as it is."""
    return ArrayField(values) if isinstance(values, np.ndarray) else values


def slabs(field: LatticeField) -> Iterator[NDArray[Any]]:
    """All numbers of a field, some layers of z at a time, in whole bricks."""
    nz, ny, nx = field.shape[:3]
    layers = BRICK * max(VOXELS_AT_ONCE // (ny * nx * BRICK * math.prod(field.shape[3:])), 1)
    for begin in range(0, nz, layers):
        yield field.part((begin, 0, 0), (min(begin + layers, nz), ny, nx))
