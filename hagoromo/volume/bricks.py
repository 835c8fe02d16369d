"""Bricks: the sparse lattice of a volume box. Bricks of 8³ voxels that hold matter are stored, with 9³ voxels each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from hagoromo.backend import arrays, check_entries, lookup
from hagoromo.errors import InputError
from hagoromo.files.memory import require
from hagoromo.volume.table import BrickTable, table_of
from hagoromo.volume.voxels import BRICK, PAIRS, STORED, VOXELS, unpacked_axis, unpacked_density

BRICKS_AT_ONCE = 1 << 14  # of which the largest density is read together: 42 MB
CHARACTER_BRICKS = 256  # that stand for all of them
MATERIALS = 256  # numbers of materials that fit a voxel
Shape = tuple[int, int, int]


@dataclass
class Grid:
    """One quantity of the voxels of some bricks: `each` values a brick in `values`, from brick number `first` on.

    Bricks of several boxes may share `values` (`in_one_pool`).
    """

    values: Any
    each: int
    count: int
    first: int = 0

    def of(self, bricks: np.ndarray) -> Any:
        """Values of some bricks, by number (n,) uint32, a Dr.Jit array."""
        import drjit as dr

        jit = arrays()
        lane, each = dr.arange(jit.UInt, len(bricks) * self.each), dr.opaque(jit.UInt, self.each)
        brick = dr.gather(jit.UInt, lookup(jit.UInt, bricks), lane // each) + dr.opaque(jit.UInt, self.first)
        return dr.gather(type(self.values), self.values, brick * each + lane % each)

    def read(self, begin: int, end: int) -> Any:
        """Values of the bricks `begin` … `end` − 1, a Dr.Jit array."""
        import drjit as dr

        index = dr.arange(arrays().UInt, (end - begin) * self.each)
        return dr.gather(
            type(self.values), self.values, index + dr.opaque(arrays().UInt, (self.first + begin) * self.each)
        )


@dataclass(frozen=True, eq=False)
class Bricks:
    """The sparse lattice: shape (nz, ny, nx) [voxels], and the stored bricks' places (n, 3) [z, y, x] in table order.

    density: pairs of halves, UInt; axis: bits, Int (see `PackedVoxels`); colour: Float16, four coefficients of the body
    colour on the box's basis, or None; material: UInt8, or None. chart: UInt, four words, or None; see `chart`.
    whole: places of all stored bricks of the box, where only those of a part of it are here.
    """

    shape: Shape
    places: np.ndarray
    density: Grid
    axis: Grid
    colour: Grid | None = None
    material: Grid | None = None
    chart: Grid | None = None
    whole: np.ndarray | None = None

    @property
    def kept(self) -> int:
        """Number of bricks that hold matter."""
        return len(self.places)

    @property
    def lattice(self) -> Shape:
        """Bricks along (z, y, x), stored or not."""
        return table_shape(self.shape)

    @cached_property
    def table(self) -> BrickTable:
        """Where the stored bricks are."""
        return table_of(self.places, self.lattice)

    @property
    def bytes(self) -> int:
        """Memory of table and bricks [byte]."""
        return self.table.bytes + self.kept * brick_bytes(
            *(grid is not None for grid in (self.colour, self.material, self.chart))
        )

    @cached_property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lattice coordinates (x, y, z) [voxel] between which all stored bricks lie: low, high; without bricks those of
        the lattice.
        """
        low, high = np.full(3, -0.5), np.array(self.shape[::-1]) - 0.5
        places = self.places if self.whole is None else self.whole
        if not len(places):
            return low, high
        first, last = (place[::-1] for place in (places.min(axis=0), places.max(axis=0)))
        behind = last + 1
        return np.where(first > 0, BRICK * first, low), np.where(behind < self.lattice[::-1], BRICK * behind, high)

    @cached_property
    def densest(self) -> float:
        """Largest density of a voxel; 0 without bricks. It is read from all of them, once."""
        import drjit as dr

        largest = 0
        for begin in range(0, self.kept, BRICKS_AT_ONCE):
            pairs = self.density.read(begin, min(begin + BRICKS_AT_ONCE, self.kept))
            largest = max(largest, int(dr.max(dr.maximum(pairs & 0xFFFF, pairs >> 16))[0]))  # halves ≥ 0 order as bits
        return float(np.uint16(largest).view(np.float16))

    @cached_property
    def character(self) -> tuple[float, float]:
        """Of CHARACTER_BRICKS bricks, evenly among the stored ones: the mean density, and the roughness of their axes.

        Roughness is the mean square of half the difference between the axes of voxels that are neighbours along x and
        both hold matter, 0…1 (the sign of an axis counts): about 0 in smooth matter, ½ where axes are random.
        """
        if not self.kept:
            return 0.0, 0.0
        some = np.unique(np.linspace(0, self.kept - 1, min(self.kept, CHARACTER_BRICKS)).astype(np.uint32))
        density = unpacked_density(np.array(self.density.of(some))).astype(np.float32)
        axis = unpacked_axis(np.array(self.axis.of(some))).astype(np.float32)
        both = (density[..., 1:] > 0.0) & (density[..., :-1] > 0.0)
        apart = np.sum((axis[..., 1:, :] - axis[..., :-1, :]) ** 2, axis=-1)[both]
        return float(density.mean()), float(0.25 * apart.mean()) if apart.size else 0.0

    def corners(self) -> np.ndarray:
        """First voxel (z, y, x) of every stored brick, in order: (bricks, 3)."""
        return self.places * BRICK

    def read(self, begin: int, end: int) -> dict[str, np.ndarray]:
        """Voxels of the bricks `begin` … `end` − 1, (k, 9, 9, 9, …): density, axis; colour and material if any."""
        stored = (-1, STORED, STORED, STORED)
        held = {
            "density": unpacked_density(np.array(self.density.read(begin, end))),
            "axis": unpacked_axis(np.array(self.axis.read(begin, end))),
        }
        if self.colour is not None:
            held["colour"] = np.array(self.colour.read(begin, end)).reshape(*stored, 4)
        if self.material is not None:
            held["material"] = np.array(self.material.read(begin, end)).reshape(stored)
        if self.chart is not None:
            held["chart"] = np.array(self.chart.read(begin, end)).reshape(*stored, 4)
        return held

    def dense(self) -> tuple[np.ndarray, np.ndarray]:
        """Density (nz, ny, nx) and axis (nz, ny, nx, 3) as float16 arrays; for tests and small boxes."""
        full = np.zeros((*(BRICK * m + 1 for m in self.lattice), 4), np.float16)
        held = self.read(0, self.kept)
        for (z, y, x), density, axis in zip(self.corners(), held["density"], held["axis"], strict=True):
            brick = full[z : z + STORED, y : y + STORED, x : x + STORED]
            brick[..., 0], brick[..., 1:] = density, axis
        full = full[tuple(slice(n) for n in self.shape)]
        return full[..., 0], full[..., 1:]


def in_one_pool(grids: Sequence[Grid]) -> None:
    """Move the values of several grids into one array and drop the old ones: no value is in memory twice."""
    import drjit as dr

    distinct = list({id(grid): grid for grid in grids}.values())
    if all(grid.values is distinct[0].values for grid in distinct):
        return
    check_entries(sum(grid.count * grid.each for grid in distinct), "the bricks of all boxes together")
    joined = dr.concat([grid.read(0, grid.count) for grid in distinct])
    dr.eval(joined)
    first = 0
    for grid in distinct:
        grid.values, grid.first = joined, first
        first += grid.count


def table_shape(shape: Shape) -> Shape:
    """Bricks along (z, y, x): interpolation reads the voxel pairs 0…n−2, so they cover n−1 voxels."""
    z, y, x = (-(-(n - 1) // BRICK) for n in shape)
    return z, y, x


def brick_bytes(colour: bool = False, material: bool = False, chart: bool = False) -> int:
    """Memory of one stored brick [byte]."""
    return 4 * PAIRS + VOXELS * (4 + 8 * colour + material + 16 * chart)


def check_bricks(count: int, what: str, colour: bool = False, material: bool = False, chart: bool = False) -> None:
    """Raises `InputError` where `what`, `count` stored bricks, does not fit the memory or the indices of arrays."""
    require(count * brick_bytes(colour, material, chart), what)
    check_entries(count * (4 * VOXELS if colour or chart else VOXELS), what)


def check_shape(shape: tuple[int, ...]) -> None:
    """Raises `InputError` unless `shape` is three numbers of at least 2 voxels."""
    if len(shape) != 3 or min(shape) < 2:
        raise InputError(f"lattice is {tuple(shape)[::-1]} voxels: give three numbers of at least 2 (x, y, z)")
