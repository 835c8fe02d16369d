"""Fibres: polylines with diameters → density and tangent of voxels. All in mm.

A fibre is cut into points a voxel apart, each of which carries the volume of its piece, spread over the eight voxels
around it: volumes are exact, edges are two voxels wide. The density is the share of space that fibres fill, over that
of one fibre in a voxel where it is thin (`one_fibre`): the smallest densities are not stored. The axis of a voxel is
the principal axis of Σ w t tᵀ over its pieces, as the sign of a tangent has no meaning.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import aligned, arrays, lookup
from hagoromo.errors import InputError
from hagoromo.files.memory import require
from hagoromo.matter.fill import LARGEST_EDGE, MM
from hagoromo.volume.store.field_blocks import FieldBlocks
from hagoromo.volume.voxels import BRICK

ALONG, ACROSS = 1.0, 0.5  # [voxels] between the points of a fibre, and between those across a thick one
POINTS_AT_ONCE, SEGMENTS_AT_ONCE = 1 << 19, 1 << 18
BRICKS_AT_ONCE = 1 << 12  # whose voxels are summed up together: 100 MB
MOST_PIECES = 1e9
MOST_ACROSS = 64.0  # [voxels] diameter of a fibre
BRICK_VOXELS = BRICK**3
BYTES_PER_BRICK = 1.2 * 16.0 * BRICK_VOXELS  # of memory, for an axis and a density
BYTES_PER_CELL = 8.0  # of the table of bricks
Runs = list[NDArray[np.int64]]


class Curves(NamedTuple):
    """Polylines. points: (n, 3) of all, one after the other; first: (k + 1), where each begins, and n; diameter (n)."""

    points: NDArray[np.float64]
    first: NDArray[np.int64]
    diameter: NDArray[np.float64]

    @property
    def segments(self) -> NDArray[np.int64]:
        """The points (m) from which a segment leads to the next one."""
        last = np.zeros(len(self.points), bool)
        last[self.first[1:] - 1] = True
        return np.flatnonzero(~last)

    @property
    def mean_diameter(self) -> float:
        """Diameter of the fibres, weighted by their volume over it, as their extinction is [mm]."""
        length = np.linalg.norm(self.points[self.segments + 1] - self.points[self.segments], axis=1)
        wide = 0.5 * (self.diameter[self.segments] + self.diameter[self.segments + 1])
        return float((length * wide**2).sum() / (length * wide).sum())


class _Pieces(NamedTuple):
    """Pieces of fibres: middle [voxels], unit tangent, volume [voxels]."""

    place: NDArray[np.float64]
    tangent: NDArray[np.float64]
    volume: NDArray[np.float64]


def one_fibre(diameter_mm: float, voxel_mm: float) -> float:
    """Share of a voxel that a fibre fills which goes straight through it: what density 1 stands for."""
    return min(0.25 * math.pi * (diameter_mm / voxel_mm) ** 2, 1.0)


def fibre_blocks(curves: Curves, voxel_mm: float) -> tuple[FieldBlocks, NDArray[np.float64]]:
    """Blocks of density and axis on voxels of edge `voxel_mm`, and the pose of their box [m]."""
    room = curves.diameter.max() + 2.0 * voxel_mm
    low, high = curves.points.min(axis=0) - room, curves.points.max(axis=0) + room
    voxels = np.ceil((high - low) / voxel_mm).astype(np.int64) + 1
    if not voxels.max() <= LARGEST_EDGE:
        raise InputError(
            f"voxel_mm {voxel_mm:g} is too fine for hair of {(high - low).max():g} mm: {LARGEST_EDGE} voxels a side "
            "at most"
        )
    if not curves.diameter.max() <= MOST_ACROSS * voxel_mm:
        raise InputError(
            f"voxel_mm {voxel_mm:g} is too fine for fibres of {curves.diameter.max():g} mm: {MOST_ACROSS:g} voxels "
            "across at most"
        )
    lattice = -(-voxels // BRICK)
    require(BYTES_PER_CELL * float(np.prod(lattice)), f"a lattice of {voxels.tolist()} voxels")
    runs = _runs(curves, voxel_mm, low)
    table = _numbered(curves, runs, voxel_mm, low, lattice)
    values = _summed(curves, runs, voxel_mm, low, lattice, table)
    pose = np.eye(4)
    pose[:3, 3] = low * MM
    blocks = FieldBlocks(
        _looked_up(table, lattice, values, voxel_mm * MM),
        (int(voxels[2]), int(voxels[1]), int(voxels[0])),
        voxel_mm * MM,
        _near_fibres(table >= 0, lattice, voxel_mm * MM),
    )
    return blocks, pose


def _runs(curves: Curves, voxel: float, low: NDArray) -> Runs:
    """The segments, by their first points, in runs of about POINTS_AT_ONCE pieces."""
    start = curves.segments
    parts = np.array_split(start, len(start) // SEGMENTS_AT_ONCE + 1)
    cut = (_segments(curves, voxel, low, some) for some in parts)
    ends = np.cumsum(np.concatenate([each.along * each.across**2 for each in cut]))
    if ends[-1] > MOST_PIECES:
        raise InputError(f"hair of {ends[-1]:.3g} pieces of a voxel: give a larger voxel_mm, or fewer hairs")
    return np.split(start, np.unique(np.searchsorted(ends, np.arange(POINTS_AT_ONCE, ends[-1], POINTS_AT_ONCE))))


def _numbered(curves: Curves, runs: Runs, voxel: float, low: NDArray, lattice: NDArray) -> NDArray[np.int64]:
    """The table of bricks: the number of each that holds a fibre, −1 of the others."""
    hit = np.zeros(int(np.prod(lattice)), bool)
    for pieces in _pieces(curves, runs, voxel, low):
        for brick, _, _ in _around(pieces.place, lattice):
            hit[brick] = True
    table = np.full(len(hit), -1, np.int64)
    table[hit] = np.arange(hit.sum())
    require(BYTES_PER_BRICK * float(hit.sum()), f"hair in {hit.sum()} bricks")
    return table


def _summed(
    curves: Curves,
    runs: list[NDArray[np.int64]],
    voxel: float,
    low: NDArray,
    lattice: NDArray,
    table: NDArray[np.int64],
) -> NDArray[np.float32]:
    """Axis, and density over that of `one_fibre`, of the voxels of all numbered bricks: (n, 4).

    They are summed up some bricks at a time, by the pieces of their heights; a voxel gets its pieces in one order.
    """
    count, held = int(table.max() + 1), np.flatnonzero(table >= 0)
    values = aligned(4 * count * BRICK_VOXELS, np.float32).reshape(-1, 4)
    for first in range(0, count, BRICKS_AT_ONCE):
        last = min(first + BRICKS_AT_ONCE, count)
        layers = held[[first, last - 1]] // (lattice[0] * lattice[1]) + [0, 1]
        sums = np.zeros((6, (last - first) * BRICK_VOXELS))  # of w t tᵀ: xx, yy, zz, xy, xz, yz
        for pieces in _pieces(curves, runs, voxel, low, BRICK * layers):
            x, y, z = pieces.tangent.T
            moments = [pieces.volume * m for m in (x * x, y * y, z * z, x * y, x * z, y * z)]
            for brick, inner, share in _around(pieces.place, lattice):
                number = table[brick] - first
                own = np.flatnonzero((number >= 0) & (number < last - first))
                index, share = number[own] * BRICK_VOXELS + inner[own], share[own]
                for total, moment in zip(sums, moments, strict=True):
                    np.add.at(total, index, share * moment[own])
        _put(sums, values[first * BRICK_VOXELS : last * BRICK_VOXELS])
    values[:, 3] /= one_fibre(curves.mean_diameter, voxel)
    return values


def _put(sums: NDArray[np.float64], values: NDArray[np.float32]) -> None:
    """Principal axis and trace of tensors, `sums` (6, n), into `values` (n, 4)."""
    density = sums[:3].sum(axis=0)
    values[:, :3], values[:, 3] = 0.0, density
    matter = np.flatnonzero(density)
    for some in np.array_split(matter, len(matter) // POINTS_AT_ONCE + 1):
        xx, yy, zz, xy, xz, yz = sums[:, some]
        tensor = np.stack([xx, xy, xz, xy, yy, yz, xz, yz, zz], axis=-1).reshape(-1, 3, 3)
        values[some, :3] = np.linalg.eigh(tensor)[1][..., 2]


class _Segments(NamedTuple):
    """Segments from a to b [voxels]: their length and diameter [voxels], and their pieces along them and across."""

    a: NDArray[np.float64]
    b: NDArray[np.float64]
    length: NDArray[np.float64]
    wide: NDArray[np.float64]
    along: NDArray[np.int64]
    across: NDArray[np.int64]


def _segments(curves: Curves, voxel: float, low: NDArray, start: NDArray[np.int64]) -> _Segments:
    """The segments that begin at the points `start`."""
    a, b = (curves.points[start] - low) / voxel, (curves.points[start + 1] - low) / voxel
    length = np.linalg.norm(b - a, axis=1)
    wide = 0.5 * (curves.diameter[start] + curves.diameter[start + 1]) / voxel
    across = np.where(wide > 2.0 * ACROSS, np.ceil(wide / ACROSS), 1).astype(np.int64)
    along = np.maximum(np.ceil(length / ALONG), 1).astype(np.int64)
    return _Segments(a, b, length, wide, along, across)


def _pieces(
    curves: Curves, runs: Runs, voxel: float, low: NDArray, heights: NDArray | None = None
) -> Iterator[_Pieces]:
    """The pieces of all fibres, some at a time; heights: those of segments that reach between two heights [voxels]."""
    for start in runs:
        some = start if heights is None else start[_reach(curves, voxel, low, start, heights)]
        cut = _segments(curves, voxel, low, some)
        for rings in np.unique(cut.across):
            own = np.flatnonzero((cut.across == rings) & (cut.length > 0))
            if len(own):
                yield _cut(cut.a[own], cut.b[own], cut.wide[own], cut.along[own], _disc(int(rings)))


def _reach(curves: Curves, voxel: float, low: NDArray, start: NDArray[np.int64], heights: NDArray) -> NDArray[np.bool_]:
    """Whether segments come within a voxel and their radius of the space between two heights [voxels]."""
    a, b = ((curves.points[each, 2] - low[2]) / voxel for each in (start, start + 1))
    room = 1.0 + 0.5 * np.maximum(curves.diameter[start], curves.diameter[start + 1]) / voxel
    return (np.maximum(a, b) + room >= heights[0]) & (np.minimum(a, b) - room <= heights[1])


def _cut(a: NDArray, b: NDArray, wide: NDArray, along: NDArray, disc: NDArray) -> _Pieces:
    """The pieces of segments from a to b [voxels], each with the points of `disc` across [diameters]."""
    which = np.repeat(np.arange(len(a)), along)
    number = np.arange(len(which)) - np.repeat(np.cumsum(along) - along, along)
    share = ((number + 0.5) / along[which])[:, None]
    offset = b - a
    length = np.linalg.norm(offset, axis=1)
    tangent = offset / length[:, None]
    place = a[which] + share * offset[which]
    volume = (0.25 * math.pi * wide**2 * length / along)[which] / len(disc)
    if len(disc) == 1:
        return _Pieces(place, tangent[which], volume)
    least = np.eye(3)[np.abs(tangent).argmin(axis=1)]
    aside = np.cross(tangent, least)
    aside /= np.linalg.norm(aside, axis=1, keepdims=True)
    above = np.cross(tangent, aside)
    out = disc[:, :1, None] * aside[None, which] + disc[:, 1:, None] * above[None, which]
    place = place + out * wide[which][None, :, None]
    times = len(disc)
    return _Pieces(place.reshape(-1, 3), np.tile(tangent[which], (times, 1)), np.tile(volume, times))


def _disc(count: int) -> NDArray[np.float64]:
    """Points that stand for equal areas of a disc of diameter 1: (k, 2)."""
    if count == 1:
        return np.zeros((1, 2))
    steps = (np.arange(count) + 0.5) / count - 0.5
    points = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    return points[(points**2).sum(axis=1) <= 0.25]


def _around(place: NDArray, lattice: NDArray) -> Iterator[tuple[NDArray, NDArray, NDArray]]:
    """Of the eight voxels around places [voxels]: number of the brick in the table, place in it, share of a piece."""
    base = np.floor(place - 0.5)
    part, low = (place - 0.5 - base).T, base.astype(np.int64).T
    steps = np.array([1, lattice[0], lattice[0] * lattice[1]]), np.array([1, BRICK, BRICK**2])
    bricks = [[(low[k] + side) // BRICK * steps[0][k] for side in (0, 1)] for k in range(3)]
    inner = [[(low[k] + side) % BRICK * steps[1][k] for side in (0, 1)] for k in range(3)]
    shares = [[1.0 - part[k], part[k]] for k in range(3)]
    for z, y, x in np.ndindex(2, 2, 2):
        yield (
            bricks[0][x] + bricks[1][y] + bricks[2][z],
            inner[0][x] + inner[1][y] + inner[2][z],
            shares[0][x] * shares[1][y] * shares[2][z],
        )


def _looked_up(table: NDArray, lattice: NDArray, values: NDArray[np.float32], voxel: float) -> Any:
    """The field of `FieldBlocks` that gathers what was summed up. values: aligned memory, which is shared."""
    jit = arrays()
    bricks, packets = lookup(jit.Int, table.astype(np.int32)), jit.Float(values.ravel())
    nx, ny = int(lattice[0]), int(lattice[1])

    def field(point: Any) -> tuple[Any, Any]:
        x, y, z = (jit.UInt(dr.fmax(point[k] * (1.0 / voxel), 0.0)) for k in range(3))
        brick = dr.gather(jit.Int, bricks, ((z // BRICK) * ny + y // BRICK) * nx + x // BRICK)
        inner = ((z % BRICK) * BRICK + y % BRICK) * BRICK + x % BRICK
        index = jit.UInt(dr.maximum(brick, 0)) * BRICK_VOXELS + inner
        packet = dr.gather(jit.Array4f, packets, index, brick >= 0)
        return packet.w, jit.Array3f(packet.x, packet.y, packet.z)

    return field


def _near_fibres(hit: NDArray[np.bool_], lattice: NDArray, voxel: float) -> Any:
    """Whether balls around points [m] reach a brick that holds fibres: asked for many balls of one radius."""
    from scipy.ndimage import distance_transform_cdt

    grid = hit.reshape(lattice[::-1])
    away = np.zeros(grid.shape, np.int32) if grid.all() else np.asarray(distance_transform_cdt(~grid, "chessboard"))

    def occupied(centre: Any, radius: float) -> NDArray[np.bool_]:
        brick = np.array(centre, np.float64).T / (voxel * BRICK)
        inside = np.clip(np.floor(brick).astype(np.int64), 0, lattice - 1)
        beyond = np.abs(brick - inside - 0.5).max(axis=1)  # ½ within the lattice
        reach = radius / (voxel * BRICK) + 1.0 + np.maximum(beyond - 0.5, 0.0)
        return away[inside[:, 2], inside[:, 1], inside[:, 0]] <= reach

    return occupied
