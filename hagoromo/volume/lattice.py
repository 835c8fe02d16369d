"""Lattice: numbers of voxels as bricks store them, and as the user's box has them, (nz, ny, nx)."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from hagoromo.volume.bricks import Bricks, Grid
from hagoromo.volume.voxels import BRICK, STORED, VOXELS

Place = tuple[slice, slice, slice]


def on_lattice(bricks: Bricks, grid: Grid, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sums over the copies of each voxel, (nz, ny, nx, …): bricks store the layer that they share with their neighbours
    more than once. 0 in bricks that are not stored.

    values: (voxels, …) of all bricks that share the memory of `grid`.
    """
    full = np.zeros((*(BRICK * m + 1 for m in bricks.lattice), *values.shape[1:]))
    for brick, place in _stored(bricks, grid):
        full[place] += values[brick].reshape(STORED, STORED, STORED, *values.shape[1:])
    return full[tuple(slice(n) for n in bricks.shape)]


def from_bricks(bricks: Bricks, grid: Grid, values: NDArray) -> NDArray:
    """Numbers of each voxel on the lattice, (nz, ny, nx, …), of those that bricks store; 0 where none is stored."""
    full = np.zeros((*(BRICK * m + 1 for m in bricks.lattice), *values.shape[1:]), values.dtype)
    for brick, place in _stored(bricks, grid):
        full[place] = values[brick].reshape(STORED, STORED, STORED, *values.shape[1:])
    return full[tuple(slice(n) for n in bricks.shape)]


def into_bricks(bricks: Bricks, grid: Grid, full: NDArray, values: NDArray) -> None:
    """Write numbers on the lattice, (nz, ny, nx, …), into `values` (voxels, …), where bricks are stored."""
    behind = [(0, BRICK * m + 1 - n) for m, n in zip(bricks.lattice, bricks.shape, strict=True)]
    padded = np.pad(full, behind + [(0, 0)] * (full.ndim - 3))
    for brick, place in _stored(bricks, grid):
        values[brick] = padded[place].reshape(VOXELS, *values.shape[1:])


def _stored(bricks: Bricks, grid: Grid) -> Iterator[tuple[slice, Place]]:
    """Of each stored brick, its voxels in memory and on the lattice."""
    for number, (z, y, x) in enumerate(bricks.corners(), grid.first):
        yield slice(VOXELS * number, VOXELS * (number + 1)), np.s_[z : z + STORED, y : y + STORED, x : x + STORED]
