"""Splat: many thin strands → a volume box with their mass and mean tangent per voxel. Lengths in mm."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import drjit as dr
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from hagoromo.backend import arrays, clip, lookup
from hagoromo.errors import InputError
from hagoromo.matter.fill import CORE, Fineness, fill
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.volume.store.plan import BoxPlan

CELL_VOXELS = 8  # voxels along an edge of a cell, the unit of storage
MOST_CELLS = 1 << 24


class StrandPoints(NamedTuple):
    """Points of strands, (n, 3); unit tangents, (n, 3); volume of strand that each holds, (n,) [mm³]; kind, 0 or 1."""

    points: NDArray[np.float32]
    tangents: NDArray[np.float32]
    volume: NDArray[np.float32]
    kind: NDArray[np.float32]


def along(paths: NDArray[np.float64], area: NDArray[np.float64] | float, step: float, kind: int = 0) -> StrandPoints:
    """Strands along `paths` (strands, points, 3) of a cross-section `area` [mm²], (strands, points) or one for all.

    Points of a path are joined by straight lines, which are sampled every `step`.
    """
    ways = np.diff(paths, axis=1)
    lengths = np.linalg.norm(ways, axis=2)
    parts = max(1, int(np.ceil(np.percentile(lengths, 99) / step)))
    share = (np.arange(parts) + 0.5) / parts
    points = paths[:, :-1, None] + share[:, None] * ways[:, :, None]
    tangents = np.broadcast_to((ways / np.maximum(lengths, 1e-9)[..., None])[:, :, None], points.shape)
    whole = np.broadcast_to(np.asarray(area, float), paths.shape[:2])
    across = whole[:, :-1, None] + share * np.diff(whole, axis=1)[..., None]
    volume = across * (lengths / parts)[..., None]
    volume = volume.ravel()
    some = volume > 0
    points, tangents = (part.reshape(-1, 3)[some].astype(np.float32) for part in (points, tangents))
    return StrandPoints(points, tangents, volume[some].astype(np.float32), np.full(len(points), kind, np.float32))


def joined(*strands: StrandPoints) -> StrandPoints:
    """All of them together."""
    return StrandPoints(*(np.concatenate(part) for part in zip(*strands, strict=True)))


def splat(
    strands: StrandPoints, materials: tuple[Reflectance, Reflectance], fineness: Fineness, **record: Any
) -> BoxPlan:
    """The box of strands of two kinds: every point gives its volume to the eight voxels around it."""
    voxel = fineness.voxel_mm
    low = np.floor(strands.points.min(axis=0) / voxel / CELL_VOXELS - 1.0) * CELL_VOXELS * voxel
    cells = np.ceil((strands.points.max(axis=0) - low) / (voxel * CELL_VOXELS)).astype(int) + 2
    if cells.prod() > MOST_CELLS:
        raise InputError(f"strands over {cells * CELL_VOXELS} voxels: make voxel_mm {voxel:g} larger")
    occupied, sums = _summed(strands, low, voxel, cells)
    mass, *tangent, second = sums
    size = np.sqrt(np.maximum(tangent[0] ** 2 + tangent[1] ** 2 + tangent[2] ** 2, 1e-24))
    for part in tangent:
        part /= size
    kind = second > 0.5 * mass
    # voxels without matter get the kind of their neighbours, because lookups between both interpolate
    around = np.repeat(
        second.reshape(-1, CELL_VOXELS**3).sum(axis=1) > 0.5 * mass.reshape(-1, CELL_VOXELS**3).sum(axis=1),
        CELL_VOXELS**3,
    )
    values = [np.minimum(mass / voxel**3, CORE), *tangent, np.where(mass > 0, kind, around)]
    table = np.full(cells.prod(), -1, np.int32)
    table[occupied] = np.arange(len(occupied))
    empty = (table < 0).reshape(cells)
    far = np.maximum(np.asarray(distance_transform_edt(empty)) - np.sqrt(3.0), 0.0) * CELL_VOXELS * voxel
    lattice = _Lattice(low, voxel, cells, table, values, np.where(empty, far, -1.0))
    field: Any = lattice.field  # gives a material too
    plan = fill(field, lattice.bound, (low, low + cells * CELL_VOXELS * voxel), fineness, materials[0], **record)
    return replace(plan, header=replace(plan.header, materials=materials))


def _summed(strands: StrandPoints, low: NDArray, voxel: float, cells: NDArray) -> tuple[NDArray, list[NDArray]]:
    """Cells that hold anything, (m,); sums over their voxels, (m·CELL³,) each: volume, its tangents x, y, z, kind 1."""
    places = ((strands.points - low) / voxel - 0.5).astype(np.float32)
    corners = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)], np.int32)
    first = np.floor(places).astype(np.int32)
    row, inner = (
        np.array(by, np.int32)
        for by in ((cells[1] * cells[2], cells[2], 1), (CELL_VOXELS * CELL_VOXELS, CELL_VOXELS, 1))
    )
    occupied = np.unique(np.concatenate([np.unique(((first + corner) // CELL_VOXELS) @ row) for corner in corners]))
    factors = [np.ones(1, np.float32), *strands.tangents.T, strands.kind]
    sums = [np.zeros(len(occupied) * CELL_VOXELS**3, np.float32) for _ in factors]
    for corner in corners:
        voxel_index = first + corner
        weight = np.abs(1 - corner - (places - first)).prod(axis=1) * strands.volume
        index = (
            np.searchsorted(occupied, (voxel_index // CELL_VOXELS) @ row) * CELL_VOXELS**3
            + (voxel_index % CELL_VOXELS) @ inner
        )
        for whole, factor in zip(sums, factors, strict=True):
            whole += np.bincount(index, weight * factor, len(whole))
    return occupied, sums


class _Lattice:
    """Density, tangent and kind at points [mm] of a sparse lattice, on the device."""

    def __init__(
        self, low: NDArray, voxel: float, cells: NDArray, table: NDArray, values: list[NDArray], far: NDArray
    ) -> None:
        """values: density, tangent x, y, z and kind of the voxels of the cells that `table` numbers."""
        jit = arrays()
        self.low, self.voxel, self.cells = [float(x) for x in low], float(voxel), [int(n) for n in cells]
        self.table, self.far = lookup(jit.Int, table), lookup(jit.Float, far.astype(np.float32))
        self.values = [lookup(jit.Float, part.astype(np.float32)) for part in values]

    def field(self, point: Any) -> tuple[Any, Any, Any]:
        """Density, tangent and kind of the voxel whose middle is nearest."""
        jit = arrays()
        cell, inner = self._cell(point)
        held = dr.gather(jit.Int, self.table, cell)
        some = held >= 0
        index = jit.UInt(held) * CELL_VOXELS**3 + inner
        density, x, y, z, kind = (dr.gather(jit.Float, part, index, some) for part in self.values)
        return density, jit.Array3f(x, y, z), jit.UInt(kind)

    def bound(self, point: Any) -> Any:
        """At most the distance to the cells that hold anything [mm]; below 0 inside them."""
        outside = dr.norm(point - self._held(point))
        return dr.gather(arrays().Float, self.far, self._cell(point)[0]) + outside

    def _held(self, point: Any) -> Any:
        """`point` moved into the lattice."""
        reach = [n * CELL_VOXELS * self.voxel for n in self.cells]
        return type(point)(*(clip(point[k], self.low[k], self.low[k] + reach[k]) for k in range(3)))

    def _cell(self, point: Any) -> tuple[Any, Any]:
        """Number of the cell of a point, and of its voxel in it."""
        jit, index, inner = arrays(), arrays().UInt(0), arrays().UInt(0)
        for k in range(3):
            place = clip((point[k] - self.low[k]) * (1.0 / self.voxel), 0.0, self.cells[k] * CELL_VOXELS - 1.0)
            whole = jit.UInt(place)
            index = index * self.cells[k] + whole // CELL_VOXELS
            inner = inner * CELL_VOXELS + whole % CELL_VOXELS
        return index, inner
