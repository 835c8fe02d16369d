"""Sparse lattice: the leaves and tiles of the trees of OpenVDB and NanoVDB, and the dense lattice that they fill.

A leaf is a cube of 8³ voxels, a tile a larger cube of one value. Their arrays have x first, as those trees have.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.checks import check_density
from hagoromo.files.volume_file import VolumeFile, check_size

LEAF = 8  # voxels along an edge
LARGEST_INDEX = 1 << 31
FEW_VOXELS, MOST_VOXELS_PER_BYTE = 1 << 24, float(1 << 16)  # of a sparse file, in its dense lattice
LEVEL_SET = "level set"


@dataclass
class SparseLattice:
    """kind: type of a number. components: numbers of a voxel. matrix: (4, 4), index (x, y, z) → place [m].

    leaves: (first voxel (3,), active (8, 8, 8), values (8, 8, 8[, components])) of each; tiles: (first voxel, edge in
    voxels, value) of those that are active. name, use: as the file calls the grid and what its numbers are for.
    """

    name: str
    use: str
    kind: Any
    components: int
    background: Any
    matrix: NDArray[np.float64]
    leaves: list[tuple[NDArray[np.int64], NDArray[np.bool_], NDArray[Any]]] = field(default_factory=list)
    tiles: list[tuple[NDArray[np.int64], int, Any]] = field(default_factory=list)

    def dense(self, where: str, file: Path | None = None) -> VolumeFile:
        """All voxels between the first and the last active ones; `InputError` where none is, or they do not fit.

        file: from which it is; where it is far smaller than the voxels, it is refused.
        """
        if self.use == LEVEL_SET:
            raise InputError(f"{where} is a level set, no density: make it a fog volume in the program it is from")
        spans = [_span(first, active) for first, active, _ in self.leaves if active.any()]
        spans += [(first, first + edge) for first, edge, _ in self.tiles]
        if not spans:
            raise InputError(f"{where} has no active voxels: give a grid that holds something")
        low = np.min([span[0] for span in spans], axis=0)
        high = np.max([span[1] for span in spans], axis=0)
        if np.abs([low, high]).max() > LARGEST_INDEX:
            raise InputError(f"{where} has voxels at {low.tolist()}: it is damaged")
        shape, last = tuple((high - low).tolist()), (self.components,) if self.components > 1 else ()
        check_size(shape, np.dtype(self.kind).itemsize * self.components, where)
        count = float(np.prod(shape, dtype=float))
        if file is not None and count > FEW_VOXELS:
            check_density(count, file, MOST_VOXELS_PER_BYTE, f"a lattice of {' × '.join(map(str, shape))}")
        values = np.empty((*shape, *last), self.kind)
        values[:] = self.background
        for first, edge, value in self.tiles:
            values[_part(first - low, edge, shape)] = value
        for first, _, leaf in self.leaves:
            to, before = _part(first - low, LEAF, shape), np.maximum(low - first, 0)
            values[to] = leaf[tuple(slice(b, b + part.stop - part.start) for b, part in zip(before, to, strict=True))]
        matrix = self.matrix.copy()
        matrix[:3, 3] += matrix[:3, :3] @ low
        return VolumeFile(np.swapaxes(values, 0, 2), matrix, where)


def chosen(grids: dict[str, Any], wanted: str, where: str) -> Any:
    """The grid called `wanted`; without a name the only one, or the one called density. `InputError` for others."""
    name = wanted or (next(iter(grids)) if len(grids) == 1 else "density")
    if name not in grids:
        names = ", ".join(grids) or "none"
        raise InputError(f"{where} has the grids {names:.300}: name one, as in FILE.vdb:NAME")
    return grids[name]


def _span(first: NDArray[np.int64], active: NDArray[np.bool_]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    inside = np.argwhere(active)
    return first + inside.min(0), first + inside.max(0) + 1


def _part(first: NDArray[np.int64], edge: int, shape: tuple[int, ...]) -> tuple[slice, ...]:
    """Where a cube lies in the lattice; of one that lies beside it nothing."""
    starts = [max(0, int(f)) for f in first]
    return tuple(slice(s, max(s, min(int(f) + edge, n))) for s, f, n in zip(starts, first, shape, strict=True))
