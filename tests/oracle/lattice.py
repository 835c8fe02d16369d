"""A volume box as plain float64 arrays, and its optical depth along rays, exact to rounding.

Density is trilinear between voxel centres and constant over the outer half voxels; along a ray it is a cubic in each
cell of the lattice, so that two Gauss points a cell give ∫ σ du exactly. Nothing here steps by a chosen length.
Extinction by the projected area of elements is no cubic: it takes AREA_NODES points a cell.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

import hagoromo as hg

DEEPEST = 45.0  # optical depth at which a ray ends: exp(−45) = 3e-20
TINY = 1e-300
LEAST_DENSITY = 1e-4  # less is no matter
GAUSS = 0.5 / np.sqrt(3.0)  # of the two points, from the middle, as a share of the segment
AREA_NODES = 3  # Gauss points of a segment, where extinction is that of the projected area of elements
Array = NDArray[np.float64]
BITS = np.array([(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)])  # corners of a cell


@dataclass(frozen=True)
class OracleVoxels:
    """Arrays (z, y, x, …) of which a box is made, and its other figures as `hg.VolumeBox` has them.

    Densities and colours are rounded to halves, as boxes store them; axes are not, so that their rounding shows. An
    empty voxel has no axis: it has no part in the axes between voxels.
    """

    density: NDArray
    axis: NDArray
    voxel_size: float
    tau: float
    materials: tuple[hg.Reflectance, ...]
    pose: Array = field(default_factory=lambda: np.eye(4))
    material: NDArray[np.uint8] | None = None
    body_colour: NDArray | None = None
    basis: tuple[hg.Spectrum, ...] = ()
    extinction: Literal["isotropic", "projected"] = "isotropic"

    def __post_init__(self) -> None:
        density = np.where(self.density < LEAST_DENSITY, 0.0, self.density)
        object.__setattr__(self, "density", density.astype(np.float16).astype(np.float64))
        object.__setattr__(self, "axis", np.where(density[..., None] > 0.0, self.axis, 0.0))
        if self.body_colour is not None:
            object.__setattr__(self, "body_colour", self.body_colour.astype(np.float16).astype(np.float64))

    def box(self) -> hg.VolumeBox:
        """The box that the march sees."""
        return hg.VolumeBox.from_arrays(**vars(self))


class BoxFields:
    """Fields of one box. Coordinates u along (x, y, z): voxel k has its centre at k + 1; matter at ½ ≤ u ≤ n + ½."""

    def __init__(self, voxels: OracleVoxels) -> None:
        self.tau, self.materials, self.basis = voxels.tau, voxels.materials, voxels.basis
        self.rotation, self.offset = voxels.pose[:3, :3], voxels.pose[:3, 3]
        self.projected = voxels.extinction == "projected"
        self.voxel, self.element = voxels.voxel_size, np.array([m.element for m in voxels.materials])
        self.density, self.axis = padded(voxels.density), padded(voxels.axis)
        self.mixed = voxels.material is not None
        material = voxels.material if voxels.material is not None else np.zeros(voxels.density.shape)
        self.material = padded(material).astype(np.intp)
        self.colour = None if voxels.body_colour is None else padded(voxels.body_colour)
        self.shape = np.array(voxels.density.shape[::-1])
        self.size = np.array(self.density.shape[::-1]) - 1  # cells
        parts = [self.density[z : z + self.size[2], y : y + self.size[1], x : x + self.size[0]] for x, y, z in BITS]
        self.corners = np.stack(parts, axis=-1).reshape(-1, 8)
        full: NDArray[np.bool_] = np.any(self.corners, axis=1)
        held = np.argwhere(full.reshape(self.size[::-1]))[:, ::-1]
        if len(held) == 0:
            held = np.zeros((1, 3), int)
        self.full = full
        self.low = np.maximum(held.min(axis=0), 0.5)
        self.high = np.minimum(held.max(axis=0) + 1.0, self.shape + 0.5)

    def ray(self, origin: Array, direction: Array) -> tuple[Array, Array, Array, Array]:
        """Origin (rays, 3) and direction in u and u per metre; where the ray enters and leaves the matter [m]."""
        start = (origin - self.offset) @ self.rotation / self.voxel + 0.5
        along = direction @ self.rotation / self.voxel
        along = np.where(np.abs(along) < 1e-12, 1e-12, along)
        a, b = (self.low - start) / along, (self.high - start) / along
        return start, along, np.minimum(a, b).max(axis=1), np.maximum(a, b).min(axis=1)

    def planes(self, origin: Array, direction: Array) -> Array:
        """Distances at which rays cross planes between cells and between voxels of other materials: (rays, planes)."""
        start, along, enter, leave = self.ray(origin, direction)
        step = 0.5 if self.mixed else 1.0
        cuts = [(np.arange(1, self.shape[k] + 1, step) - start[:, k, None]) / along[:, k, None] for k in range(3)]
        cuts = np.concatenate([*cuts, enter[:, None], leave[:, None]], axis=1)
        enter = np.maximum(enter, 0.0)
        return np.clip(cuts, enter[:, None], np.maximum(leave, enter)[:, None])

    def depth_between(self, origin: Array, direction: Array, near: Array, far: Array) -> Array:
        """Optical depth of segments that lie in one cell each, or outside the matter: (segments,)."""
        start, along, enter, leave = self.ray(origin, direction)
        middle, length = 0.5 * (near + far), far - near
        depth = np.zeros(len(near))
        inside = np.flatnonzero((middle > enter) & (middle < leave))
        start, along, middle, length = start[inside], along[inside], middle[inside], length[inside]
        cell = np.floor(start + along * middle[:, None])
        depth[inside] = self._cell_depth(start, along, cell, middle, length)
        return depth

    def depth_to(self, origin: Array, direction: Array, distance: Array) -> Array:
        """Optical depth from points to `distance` [m] along directions, cell by cell: (rays,)."""
        start, along, enter, leave = self.ray(origin, direction)
        at, end = np.maximum(enter, 0.0), np.minimum(leave, distance)
        depth, alive = np.zeros(len(at)), np.flatnonzero(end > at)
        start, along, at, end = start[alive], along[alive], at[alive], end[alive]
        sign = np.where(along > 0.0, 1.0, -1.0)
        place = start + along * at[:, None]
        cell = np.floor(place + 1e-9 * sign)
        while len(alive):
            cuts = (cell + (sign > 0.0) - start) / along
            which = np.argmin(cuts, axis=1)
            leaving = np.clip(np.take_along_axis(cuts, which[:, None], axis=1)[:, 0], at, end)
            depth[alive] += self._cell_depth(start, along, cell, 0.5 * (at + leaving), leaving - at)
            rows = np.arange(len(alive))
            cell[rows, which] += sign[rows, which]
            at = leaving
            on = (at < end) & (depth[alive] < DEEPEST)
            if not on.all():
                alive, start, along, at = alive[on], start[on], along[on], at[on]
                end, cell, sign = end[on], cell[on], sign[on]
        return depth

    def _cell_depth(self, start: Array, along: Array, cell: Array, middle: Array, length: Array) -> Array:
        """∫ σ over segments of given middle and length [m], each in the cell given: (segments,)."""
        flat = self.flat(cell)
        depth, held = np.zeros(len(flat)), np.flatnonzero(self.full[flat])
        if len(held) == 0:
            return depth
        if self.projected:
            rays = start[held], along[held]
            depth[held] = self._projected_depth(*rays, cell[held], middle[held], length[held])
            return depth
        corners, length = self.corners[flat[held]], length[held]
        place, half = (start + along * middle[:, None] - cell)[held], along[held] * (GAUSS * length)[:, None]
        both = trilinear(corners, place - half) + trilinear(corners, place + half)
        depth[held] = np.maximum(0.5 * self.tau * length * both, 0.0)
        return depth

    def _projected_depth(self, start: Array, along: Array, cell: Array, middle: Array, length: Array) -> Array:
        """∫ τ ρ A over segments in one cell each: (segments,)."""
        nodes, weights = np.polynomial.legendre.leggauss(AREA_NODES)
        distance = middle[:, None] + 0.5 * length[:, None] * nodes
        place = (start[:, None] + along[:, None] * distance[..., None]).reshape(-1, 3)
        density = trilinear(
            np.repeat(self.corners[self.flat(cell)], AREA_NODES, axis=0), place - np.repeat(cell, AREA_NODES, axis=0)
        )
        area = self.projected_area(place, np.repeat(along @ self.rotation.T, AREA_NODES, axis=0))
        return 0.5 * self.tau * length * ((np.maximum(density, 0.0) * area).reshape(-1, AREA_NODES) @ weights)

    def projected_area(self, place: Array, way: Array) -> Array:
        """mean |N·ω| over the normals of the elements at places u, along directions `way` (world): (places,)."""
        number, axis, _ = self.matter(place)
        cosine = np.sum(axis * way, axis=1) / np.linalg.norm(way, axis=1)
        sine, element = np.sqrt(np.maximum(1.0 - cosine**2, 0.0)), self.element[number]
        return np.select([element == "plane", element == "cylinder"], [np.abs(cosine), 2.0 / np.pi * sine], 0.5)

    def flat(self, cell: Array) -> NDArray[np.intp]:
        """Row of each cell in `corners`."""
        x, y, z = np.clip(cell, 0, self.size - 1).astype(np.intp).T
        return (z * self.size[1] + y) * self.size[0] + x

    def extinction(self, place: Array, way: Array) -> Array:
        """σ [1/m] at places u for light along directions `way` (world); 0 outside the matter."""
        cell = np.floor(place)
        inside = ((place >= self.low) & (place <= self.high)).all(axis=1)
        sigma = self.tau * trilinear(self.corners[self.flat(cell)], place - cell) * inside
        return sigma * self.projected_area(place, way) if self.projected else sigma

    def matter(self, place: Array) -> tuple[NDArray[np.intp], Array, Array | None]:
        """At places u: number of the material, unit axis (world), and coefficients of the colour (None: no colours).

        A voxel adds its density times its weight. The material is that of the voxel that adds most; colour is the mean
        by what voxels add. Axes are blended, by weight alone, among voxels with matter of that element; tangents, which
        have no sign, after each is turned to the side of the heaviest.
        """
        cell = np.clip(np.floor(place), 0, self.size - 1).astype(np.intp)
        corner = tuple((cell[:, None] + BITS).T[::-1])
        part = (place - cell)[:, None]
        weight = np.prod(np.where(BITS, part, 1.0 - part), axis=-1).T  # (8, places)
        added = weight * self.density[corner]
        number = self.material[corner]
        chosen = np.take_along_axis(number, np.argmax(added, axis=0)[None], axis=0)[0]
        colour = None
        if self.colour is not None:
            colour = np.einsum("vp,vpk->pk", added, self.colour[corner]) / np.maximum(added.sum(axis=0), TINY)[:, None]
        weight = np.where(self.element[number] == self.element[chosen], weight, 0.0)
        axis = self.axis[corner]
        heaviest = np.argmax(np.where(axis.any(axis=-1), weight, -1.0), axis=0)
        towards = np.take_along_axis(axis, heaviest[None, :, None], axis=0)
        turned = (np.sum(axis * towards, axis=-1) < 0.0) & (self.element[chosen] == "cylinder")
        mean = np.einsum("vp,vpk->pk", np.where(turned, -weight, weight), axis) @ self.rotation.T
        return chosen, mean / np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), TINY), colour


def trilinear(corners: Array, part: Array) -> Array:
    """Between the eight corners (cells, 8) of cells, x fastest, at parts 0…1 (cells, 3)."""
    x, y, z = part[:, 0, None], part[:, 1, None], part[:, 2]
    along = corners[:, 0::2] * (1.0 - x) + corners[:, 1::2] * x
    across = along[:, 0::2] * (1.0 - y) + along[:, 1::2] * y
    return across[:, 0] * (1.0 - z) + across[:, 1] * z


def padded(grid: NDArray) -> Array:
    """With its outer voxels repeated once on every side."""
    return np.pad(grid.astype(np.float64), [(1, 1)] * 3 + [(0, 0)] * (grid.ndim - 3), mode="edge")
