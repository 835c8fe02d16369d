"""Bricks: the sparse lattice of a volume box. Only bricks of 8³ voxels that hold matter are kept, with 9³ voxels each.

Enter: a function of voxel indices, dense arrays, or bricks written one after the other (`BrickWriter`). Memory follows
the kept bricks, never the lattice around them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from hagoromo.backend import aligned, arrays
from hagoromo.errors import InputError
from hagoromo.files.door import check_memory
from hagoromo.volume.table import BrickTable, in_table_order, table_of
from hagoromo.volume.voxels import (
    BRICK,
    PAIRS,
    STORED,
    VOXELS,
    packed_axis,
    packed_density,
    unpacked_axis,
    unpacked_density,
)

CHUNK = 1 << 12  # bricks evaluated at once
TOLD = 1 << 18  # bricks between two looks at the free memory
PARTS = 4  # along each edge, of a cube that `occupied` does not promise to be empty
MATERIALS = 256  # numbers of materials that fit a voxel
DENSEST = 6e4  # density that fits a half
Shape = tuple[int, int, int]
Field = Callable[[Any, Any, Any], dict[str, Any]]
Occupied = Callable[[Any, float], Any]


@dataclass
class Grid:
    """One quantity of the voxels of some bricks: `each` values a brick in `values`, from brick number `first` on.

    Bricks of several boxes may share `values` (`in_one_pool`).
    """

    values: Any
    each: int
    count: int
    first: int = 0

    def read(self, begin: int, end: int) -> Any:
        """Values of the bricks `begin` … `end` − 1, a Dr.Jit array."""
        import drjit as dr

        index = dr.arange(arrays().UInt, (end - begin) * self.each)
        return dr.gather(
            type(self.values), self.values, index + dr.opaque(arrays().UInt, (self.first + begin) * self.each)
        )


@dataclass(frozen=True, eq=False)
class Bricks:
    """The sparse lattice: shape (nz, ny, nx) [voxels], and the kept bricks' places (n, 3) [z, y, x] in table order.

    density: pairs of halves, UInt; axis: bits, Int (see `PackedVoxels`); colour: Float16, four coefficients of the body
    colour on the box's basis, or None; material: UInt8, or None.
    """

    shape: Shape
    places: np.ndarray
    density: Grid
    axis: Grid
    colour: Grid | None = None
    material: Grid | None = None

    @property
    def kept(self) -> int:
        """Number of bricks that hold matter."""
        return len(self.places)

    @property
    def lattice(self) -> Shape:
        """Bricks along (z, y, x), kept or not."""
        return table_shape(self.shape)

    @cached_property
    def table(self) -> BrickTable:
        """Where the kept bricks are."""
        return table_of(self.places, self.lattice)

    @property
    def bytes(self) -> int:
        """Memory of table and bricks [byte]."""
        return self.table.bytes + self.kept * brick_bytes(self.colour is not None, self.material is not None)

    def corners(self) -> np.ndarray:
        """First voxel (z, y, x) of every kept brick, in order: (bricks, 3)."""
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
    """Move the values of several grids into one array, where they stay: nothing is held twice."""
    import drjit as dr

    distinct = list({id(grid): grid for grid in grids}.values())
    if all(grid.values is distinct[0].values for grid in distinct):
        return
    joined = dr.concat([grid.read(0, grid.count) for grid in distinct])
    dr.eval(joined)
    first = 0
    for grid in distinct:
        grid.values, grid.first = joined, first
        first += grid.count


class BrickWriter:
    """Bricks written one after the other into memory taken once: `places` are sorted into table order first."""

    def __init__(self, shape: Shape, places: np.ndarray, colour: bool = False, material: bool = False) -> None:
        import drjit as dr

        check_shape(shape)
        kinds, self.shape = arrays(), shape
        self.places = in_table_order(places, table_shape(shape))
        count = max(len(self.places), 1)  # without matter, one empty brick that is never read
        check_memory(count * brick_bytes(colour, material), f"{count} bricks of a lattice of {shape[::-1]} voxels")
        wanted = {
            "density": (kinds.UInt, PAIRS), "axis": (kinds.Int, VOXELS),
            "colour": (kinds.Float16, VOXELS * 4) if colour else None,
            "material": (kinds.UInt8, VOXELS) if material else None,
        }  # fmt: skip
        self.grids = {
            name: Grid(dr.zeros(kind[0], count * kind[1]), kind[1], count) for name, kind in wanted.items() if kind
        }
        dr.eval([grid.values for grid in self.grids.values()])

    def write(self, first: int, density: Any, axis: Any, colour: Any = None, material: Any = None) -> None:
        """Write bricks from number `first` on: density (k · 729), axis (k · 729 · 3), colour (… · 4), material (…).

        NumPy arrays, flat or shaped, or Dr.Jit arrays (axis an Array3f, colour an Array4f, numbers for all voxels may
        have width 1). Checked: finite, 0 ≤ density < 6e4.
        """
        import drjit as dr

        UInt = arrays().UInt
        bricks, values = packed_voxels(density, axis, colour, material)
        for name, grid in self.grids.items():
            index = dr.arange(UInt, bricks * grid.each) + dr.opaque(UInt, first * grid.each)
            dr.scatter(grid.values, values[name], index)
        dr.eval([grid.values for grid in self.grids.values()])

    def bricks(self) -> Bricks:
        """What has been written."""
        return Bricks(self.shape, self.places, **self.grids)


def packed_voxels(density: Any, axis: Any, colour: Any = None, material: Any = None) -> tuple[int, dict[str, Any]]:
    """Number of bricks, and what grids keep of their voxels, by name; arguments and checks: see `BrickWriter.write`."""
    import drjit as dr

    kinds = arrays()
    density = _flat(density, kinds.Float)
    check_density(density)
    axis = _flat(axis, kinds.Array3f)
    axis = dr.select(density > 0, axis, 0)
    if not bool(np.array(dr.all(dr.isfinite(dr.squared_norm(axis)))).ravel()[0]):
        raise InputError("the axis of a voxel with matter is not finite: give unit vectors or zeros")
    values = {"density": packed_density(density), "axis": packed_axis(axis)}
    if colour is not None:
        values["colour"] = dr.ravel(kinds.Array4f16(_flat(colour, kinds.Array4f)))
    if material is not None:
        values["material"] = kinds.UInt8(_flat(material, kinds.UInt))
    return dr.width(density) // VOXELS, values


def table_shape(shape: Shape) -> Shape:
    """Bricks along (z, y, x): interpolation meets voxel pairs 0…n−2, so n−1 of them are covered."""
    z, y, x = (-(-(n - 1) // BRICK) for n in shape)
    return z, y, x


def brick_bytes(colour: bool = False, material: bool = False) -> int:
    """Memory of one kept brick [byte]."""
    return 4 * PAIRS + VOXELS * (4 + 8 * colour + material)


def bricks_from_field(field: Field, shape: Shape, occupied: Occupied | None = None) -> Bricks:
    """Bricks of `field`, evaluated chunk by chunk.

    field(x, y, z): voxel indices (UInt) → {"density", "axis" (Array3f), optional "colour" (list of ≤ 4), "material"}.
    occupied(middle, radius): optional, False promises that the ball [voxels] around `middle` (Array3f, lattice
    coordinates) is empty; asked of large cubes first, then of their parts.
    """
    import drjit as dr

    check_shape(shape)
    kinds, kept, count, checked = arrays(), [np.zeros((0, 3), np.int32)], 0, 0
    for places in candidates(table_shape(shape), occupied):
        if count - checked > TOLD:  # what will not fit is refused while it is counted
            check_memory(count * brick_bytes(), f"more than {count} bricks of a lattice of {shape[::-1]} voxels")
            checked = count
        x, y, z = _indices(places, shape)
        density = kinds.Float(field(x, y, z)["density"]) + 0.0 * kinds.Float(x)  # as wide as the voxels
        check_density(density)
        kept.append(places[np.array(dr.block_reduce(dr.ReduceOp.Max, density, VOXELS)) > 0])
        count += len(kept[-1])
    first = field(*(kinds.UInt(0) for _ in range(3)))
    writer = BrickWriter(shape, np.concatenate(kept), "colour" in first, "material" in first)
    for start in range(0, len(writer.places), CHUNK):
        x, y, z = _indices(writer.places[start : start + CHUNK], shape)
        voxel = field(x, y, z)
        colour = voxel.get("colour")
        if colour is not None:
            colour = kinds.Array4f(*colour, *[0.0] * (4 - len(colour)))
        density = kinds.Float(voxel["density"]) + 0.0 * kinds.Float(x)
        writer.write(start, density, kinds.Array3f(voxel["axis"]), colour, voxel.get("material"))
    return writer.bricks()


def candidates(lattice: Shape, occupied: Occupied | None) -> Iterator[np.ndarray]:
    """Places (≤ CHUNK, 3) of the bricks that may hold matter: all of them, or those that `occupied` does not exclude.

    Large cubes are asked about first; those that may hold matter are cut into PARTS³, down to bricks.
    """
    size = 1
    while occupied and PARTS * PARTS * size <= max(lattice):
        size *= PARTS
    across = tuple(-(-n // size) for n in lattice)
    count = int(np.prod(across, dtype=np.int64))
    for start in range(0, count, CHUNK):
        places = np.stack(np.unravel_index(np.arange(start, min(start + CHUNK, count)), across), axis=-1)
        yield from _within(places.astype(np.int32) * size, size, lattice, occupied)


def _within(places: np.ndarray, size: int, lattice: Shape, occupied: Occupied | None) -> Iterator[np.ndarray]:
    """Bricks in the cubes of `size` bricks at `places`, chunk by chunk."""
    places = places[(places < lattice).all(axis=1)]
    if occupied and len(places):
        middle = places[:, ::-1] * float(BRICK) + 0.5 * size * BRICK
        middle = arrays().Array3f(*(np.ascontiguousarray(middle[:, k], np.float32) for k in range(3)))
        places = places[np.array(occupied(middle, 0.5 * 3**0.5 * (size * BRICK + 1)))]
    if not len(places):
        return
    if size == 1:
        yield places
        return
    size //= PARTS
    parts = (places[:, None] + np.array(list(np.ndindex(PARTS, PARTS, PARTS)), np.int32) * size).reshape(-1, 3)
    for start in range(0, len(parts), CHUNK):
        yield from _within(parts[start : start + CHUNK], size, lattice, occupied)


def bricks_from_arrays(
    density: np.ndarray, axis: np.ndarray, colour: np.ndarray | None, material: np.ndarray | None
) -> Bricks:
    """Bricks of dense arrays (nz, ny, nx): density, axis (…, 3), colour (…, ≤ 4), material."""
    nz, ny, nx = density.shape
    check_shape(density.shape)
    check_density(np.asarray(density, np.float32))
    places = np.argwhere(occupied_bricks(density > 0))
    writer = BrickWriter((nz, ny, nx), places, colour is not None, material is not None)
    if colour is not None and colour.shape[-1] < 4:
        colour = np.concatenate([colour, np.zeros((*colour.shape[:-1], 4 - colour.shape[-1]), colour.dtype)], axis=-1)
    steps, shape = np.arange(STORED), np.array(density.shape)
    for start in range(0, len(writer.places), CHUNK):
        first = writer.places[start : start + CHUNK, None] * BRICK + steps[None, :, None]
        z, y, x = np.moveaxis(np.minimum(first, shape - 1), -1, 0)
        index = z[:, :, None, None], y[:, None, :, None], x[:, None, None, :]
        writer.write(
            start, density[index], axis[index],
            None if colour is None else colour[index], None if material is None else material[index],
        )  # fmt: skip
    return writer.bricks()


def occupied_bricks(matter: np.ndarray) -> np.ndarray:
    """Which bricks hold matter, their shared layer of neighbours included: bool (nz, ny, nx) → bool table."""
    for axis, count in enumerate(table_shape(matter.shape)):
        layers = np.moveaxis(matter, axis, 0)
        layers = np.stack([layers[i * BRICK : i * BRICK + STORED].any(axis=0) for i in range(count)])
        matter = np.moveaxis(layers, 0, axis)
    return matter


def check_shape(shape: tuple[int, ...]) -> None:
    """Raises `InputError` unless `shape` is three numbers of at least 2 voxels."""
    if len(shape) != 3 or min(shape) < 2:
        raise InputError(f"lattice is {tuple(shape)[::-1]} voxels: give three numbers of at least 2 (x, y, z)")


def check_density(density: Any) -> None:
    """Raises `InputError` unless all densities (NumPy or Dr.Jit array) are finite and from 0 to DENSEST."""
    import drjit as dr

    reduced = (density.min(), density.max()) if isinstance(density, np.ndarray) else (dr.min(density), dr.max(density))
    low, high = (float(np.array(value).ravel()[0]) for value in reduced) if len(density) else (0.0, 0.0)
    if not (np.isfinite(low) and np.isfinite(high)):
        raise InputError("density has NaN or infinite values: give finite numbers of 0 or more")
    if low < 0:
        raise InputError(f"density goes down to {low:.3g}: give numbers of 0 or more")
    if high > DENSEST:
        raise InputError(f"density goes up to {high:.3g}: keep it below 6e4 (it is stored in halves) and raise tau")


def _indices(places: np.ndarray, shape: Shape) -> tuple[Any, Any, Any]:
    """Voxel indices x, y, z of the 9³ voxels of each brick (beyond the lattice: its last layer)."""
    import drjit as dr

    UInt = arrays().UInt
    local = dr.arange(UInt, len(places) * VOXELS)
    brick, inner = local // VOXELS, local % VOXELS
    offsets = (inner // STORED**2, (inner // STORED) % STORED, inner % STORED)
    z, y, x = (
        dr.minimum(
            dr.gather(UInt, UInt(np.ascontiguousarray(places[:, k], np.uint32)), brick) * BRICK + offsets[k],
            shape[k] - 1,
        )
        for k in range(3)
    )
    return x, y, z


def _flat(values: Any, kind: Any) -> Any:
    """Values, NumPy or Dr.Jit, as a Dr.Jit array of `kind`; NumPy's are moved to aligned memory, see `lookup`."""
    import drjit as dr

    if not isinstance(values, np.ndarray):
        return kind(values)
    memory = aligned(values.size, np.uint32 if kind is arrays().UInt else np.float32)
    memory.reshape(values.shape)[...] = values
    if kind in (arrays().UInt, arrays().Float):
        return kind(memory)
    return dr.unravel(kind, arrays().Float(memory))
