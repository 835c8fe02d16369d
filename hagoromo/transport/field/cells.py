"""Cells: the coarse sparse grid on which light of higher orders is solved. Its axes are those of the world.

Stored are the cells that hold matter, then those around them, in which light is known, too, so that it can be
interpolated at every sample. A table over all cells of the grid says which is which.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import drjit as dr
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_cdt

from hagoromo.backend import Array3f, Bool, Float, Int, UInt, arrays, lookup, opaque_vector
from hagoromo.errors import InputError
from hagoromo.files.memory import require
from hagoromo.transport.textures import HEIGHT_ERROR
from hagoromo.volume.box import VolumeBox
from hagoromo.volume.voxels import BRICK, STORED, unpacked_density

MOST_PLACES = 1 << 27  # cells of the grid, stored or not
MARGIN = 2  # cells around all matter
BRICKS_AT_ONCE = 2048  # whose heights are read together
Bounds = tuple[NDArray[np.float64], NDArray[np.float64]]


@dataclass(frozen=True, eq=False)
class StoredCells:
    """What `Cells` are made of again. low, size: theirs. shape: cells along x, y, z. filled, known: bits, whether each
    cell of the grid holds matter, and whether each stored one is in the table.
    """

    low: NDArray[np.float64]
    size: float
    shape: tuple[int, ...]
    filled: NDArray[np.uint8]
    known: NDArray[np.uint8]


class Cells:
    """Cubes of edge `size` [m] from the corner `low` (3,) on, in the coordinates of the boxes.

    places: (count, 3) of the stored cells, x, y, z; the first `filled` hold matter.
    """

    def __init__(
        self,
        low: NDArray[np.float64],
        size: float,
        filled: NDArray[np.bool_],
        centroids: NDArray[np.float64] | None = None,
    ) -> None:
        """`filled`: (nz, ny, nx), whether a cell holds matter; none at the sides of the grid. centroids: (filled, 3) of
        the matter, in the coordinates of the boxes; None of a grid that does not receive light.
        """
        jit = arrays()
        stored = with_neighbours(filled)
        matter, around = (np.argwhere(which)[:, ::-1] for which in (filled, stored & ~filled))
        self.places = np.concatenate([matter, around])
        self.filled, self.count, self.size, self.low = len(matter), len(self.places), size, low
        distance = -np.asarray(distance_transform_cdt(~stored, metric="chessboard"), np.int32)
        distance[tuple(self.places.T[::-1])] = np.arange(self.count)
        self.table = lookup(jit.Int, distance)
        self.shape = filled.shape[::-1]
        self.last, self.row, self.layer = (
            opaque_vector(np.array(self.shape) - 1.0),
            dr.opaque(jit.Int, self.shape[0]),
            dr.opaque(jit.Int, self.shape[0] * self.shape[1]),
        )
        self.corner, self.per_metre = opaque_vector(low), dr.opaque(jit.Float, 1.0 / size)
        self.matter, self.matter_count = dr.opaque(jit.Int, self.filled), dr.opaque(jit.UInt, self.filled)
        self.middles = lookup(jit.Float, np.pad(self.places + 0.5, ((0, 0), (0, 1))).astype(np.float32))
        self.edge = dr.opaque(jit.Float, size)
        self.centroids = centroids
        dr.eval(self.table)

    @classmethod
    def of(cls, stored: StoredCells) -> Cells:
        """The cells that `stored` gave, their table bit by bit. `InputError` where sizes do not fit each other."""
        shape = tuple(int(n) for n in stored.shape)[::-1]
        places = float(np.prod(shape, dtype=float))
        if len(shape) != 3 or not 0.0 < places <= MOST_PLACES or stored.low.shape != (3,) or not stored.size > 0.0:
            raise InputError(f"cells of light: a grid of {shape} is none")
        require(9.0 * places, "the grid of light")
        cells = cls(stored.low, stored.size, _from_bits(stored.filled, int(places)).reshape(shape))
        cells.without(lookup(arrays().Bool, ~_from_bits(stored.known, cells.count)))
        return cells

    def stored(self) -> StoredCells:
        """What the cells are made of again, without centroids."""
        filled = np.zeros(self.shape[::-1], bool)
        filled[tuple(self.places[: self.filled].T[::-1])] = True
        known = np.array(self.table).reshape(self.shape[::-1])[tuple(self.places.T[::-1])] >= 0
        return StoredCells(self.low, self.size, tuple(self.shape), np.packbits(filled), np.packbits(known))

    @property
    def bytes(self) -> int:
        """Memory of the table [byte]."""
        return 4 * dr.width(self.table)

    def place(self, point: Array3f) -> Array3f:
        """Coordinates on the grid, whole at the corners of cells."""
        return (point - self.corner) * self.per_metre

    def without(self, unknown: Bool) -> None:
        """Take stored cells out of the table."""
        jit = arrays()
        cell = jit.Array3i(self.centre(dr.arange(jit.UInt, self.count)))
        dr.scatter(self.table, jit.Int(-1), cell.z * self.layer + cell.y * self.row + cell.x, unknown)
        dr.eval(self.table)

    def centre(self, number: UInt) -> Array3f:
        """Places of the middles of stored cells, on the grid."""
        x, y, z, _ = dr.gather(arrays().Array4f, self.middles, number)
        return arrays().Array3f(x, y, z)

    def coarser(self, times: int) -> Cells:
        """Cells with an edge `times` as long, of which those hold matter that a filled one is part of. The grid has a
        whole number of them.
        """
        filled = np.zeros([n // times for n in self.shape[::-1]], bool)
        filled[tuple(self.places[: self.filled].T[::-1] // times)] = True
        return Cells(self.low, times * self.size, filled)

    def find(self, cell: Int, active: Bool = True) -> Int:
        """Number of the stored cell at `cell` (Array3i), or the distance [cells] to the next one, below 0."""
        return dr.gather(arrays().Int, self.table, cell.z * self.layer + cell.y * self.row + cell.x, active)

    def holds(self, number: Int) -> Bool:
        """Whether a cell holds matter."""
        return (number >= 0) & (number < self.matter)

    def inside(self, cell: Int) -> Bool:
        """Whether there is a cell at `cell` (Array3i)."""
        return dr.all((cell >= 0) & (cell <= arrays().Array3i(self.last)))

    def around(self, place: Array3f) -> tuple[list[Int], list[Float]]:
        """The eight stored cells whose middles stand around a place on the grid, and their weights; below 0 where there
        is none.
        """
        jit, place = arrays(), place - 0.5
        first = jit.Array3i(dr.floor(place))
        share = place - jit.Array3f(first)
        last = jit.Array3i(self.last)
        cells, weights = [], []
        for z in (0, 1):
            for y in (0, 1):
                for x in (0, 1):
                    cell = dr.minimum(dr.maximum(first + jit.Array3i(x, y, z), 0), last)
                    cells.append(self.find(cell))
                    each = [share[k] if on else 1.0 - share[k] for k, on in enumerate((x, y, z))]
                    weights.append(each[0] * each[1] * each[2])
        return cells, weights


def _from_bits(bits: NDArray[np.uint8], count: int) -> NDArray[np.bool_]:
    """`count` truth values; `InputError` for another number of bits."""
    if bits.dtype != np.uint8 or bits.shape != (-(-count // 8),):
        raise InputError(f"cells of light: bits of {bits.shape} bytes are not those of {count} cells")
    return np.unpackbits(bits, count=count).astype(bool)


def with_neighbours(cells: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Some cells of a grid (nz, ny, nx), and the 26 around each."""
    for axis in range(3):
        wider, ways = cells.copy(), np.moveaxis(cells, axis, 0)
        along = np.moveaxis(wider, axis, 0)
        along[1:] |= ways[:-1]
        along[:-1] |= ways[1:]
        cells = wider
    return cells


def grid_over(bounds: Sequence[Bounds], size: float) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Corner of a grid of cells of edge `size` [m], and which of them the parts of boxes within `bounds` touch:
    (nz, ny, nx). See `bounds_of`.

    `InputError` for boxes that stand so far apart that the grid has more than MOST_PLACES cells.
    """
    low = np.min([low.min(axis=0) for low, _ in bounds], axis=0) - MARGIN * size
    high = np.max([high.max(axis=0) for _, high in bounds], axis=0) + MARGIN * size
    shape = np.ceil((high - low) / size).astype(int)
    if shape.prod(dtype=float) > MOST_PLACES:
        raise InputError(
            f"the boxes stand {np.linalg.norm(high - low):.3g} m apart, too far for one grid of light in cells of "
            f"{size:.2g} m: render them in mode march, or apart"
        )
    require(float(9 * shape.prod()), "the grid of light")
    touched = np.zeros(tuple(shape[::-1]), bool)
    for begin, end in bounds:
        first, last = (((corner - low) / size).astype(int) for corner in (begin, end))
        reach = (last - first).max(axis=0) + 1
        if len(first) > reach.prod():  # many small parts
            for step in np.ndindex(*reach):
                x, y, z = np.minimum(first + step, last).T
                touched[z, y, x] = True
            continue
        for (x, y, z), (u, v, w) in zip(first, last + 1, strict=True):
            touched[z:w, y:v, x:u] = True
    return low, touched


def bounds_of(boxes: Sequence[VolumeBox]) -> list[Bounds]:
    """`matter_bounds` of the boxes that hold matter; where none does, the corners of them all."""
    corners = np.concatenate([box.matter_corners() for box in boxes])
    nothing = [(corners.min(axis=0)[None], corners.max(axis=0)[None])]
    return [matter_bounds(box) for box in boxes if box.bricks.kept] or nothing


def matter_bounds(box: VolumeBox) -> Bounds:
    """Corners, in the coordinates of the box's pose [m], between which each stored brick lies; of a box with a texel
    each voxel in reach of its matter: (parts, 3) each.
    """
    if box.texel:
        middle, half = voxels_in_reach(box) * box.voxel_size, 0.5 * box.voxel_size
    else:
        edge = box.voxel_size * BRICK
        middle = (box.bricks.places[:, ::-1] + 0.5) * edge + 0.5 * box.voxel_size
        half = 0.5 * edge + 0.5 * box.voxel_size
    reach = np.abs(box.pose[:3, :3]).sum(axis=1) * half
    middle = middle @ box.pose[:3, :3].T + box.pose[:3, 3]
    return middle - reach, middle + reach


def voxels_in_reach(box: VolumeBox) -> NDArray[np.float64]:
    """Middles of the lattice cells of a box with a texel whose heights may be those of its matter, x, y, z [voxel]."""
    texel, (low, high), places = box.texel, box.band, []
    assert texel is not None
    slack = HEIGHT_ERROR * box.voxel_size
    for begin in range(0, box.bricks.kept, BRICKS_AT_ONCE):
        end = min(begin + BRICKS_AT_ONCE, box.bricks.kept)
        share = unpacked_density(np.array(box.bricks.density.read(begin, end)))
        height = low + (high - low) * np.asarray(share, np.float64).reshape(-1, *[STORED] * 3)
        around = np.stack([height[:, z : z + BRICK, y : y + BRICK, x : x + BRICK] for z, y, x in np.ndindex(2, 2, 2)])
        there = (around.min(axis=0) <= texel.top + slack) & (around.max(axis=0) >= texel.bottom - slack)
        brick, *cell = np.nonzero(there)
        places.append(box.bricks.places[begin:end][brick] * float(BRICK) + np.stack(cell, axis=1) + 1.0)
    return np.concatenate(places)[:, ::-1]
