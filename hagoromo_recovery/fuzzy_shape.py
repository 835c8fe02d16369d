"""Fuzzy shape: an extinction, axes of fibres, body colours and a gloss on a lattice, as plain arrays."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo_recovery.field.density_field import DensityField
from hagoromo_recovery.field.fuzzy_moves import LEAST
from hagoromo_recovery.field.matter_field import COLOURS, MatterField
from hagoromo_recovery.outline.hull import redistanced, signed_distance, way_to
from hagoromo_recovery.outline.lattice import Lattice
from hagoromo_recovery.shading.shading import GLOSS, START, coordinates
from hagoromo_recovery.surface_shape import GREY, SurfaceShape

FIRST_DEPTH = 0.15  # extinction of the hull [1/voxel]
THIN = 3e-3  # extinction [1/voxel] below which a node counts as empty between levels
KEPT_AROUND = 2.0  # voxels around what is left, in which there may be matter on the next level
HALF_DEPTH = 0.5  # optical depth, along the clearest way out, of the surface that stands for the matter
STEEP, REACH = 1e-2, 4.0  # least slope of that depth [1/voxel], and the distance from the surface up to which it counts


@dataclass(frozen=True, eq=False)
class FuzzyShape:
    """An object without a surface. density: (nz, ny, nx) extinction [1/voxel]. axes: (nz, ny, nx, 3) unit tangents.
    colours: (nz, ny, nx, 3). reach: (nz, ny, nx) signed distance to where there may be matter [voxel].
    """

    lattice: Lattice
    density: NDArray[np.float32]
    axes: NDArray[np.float32]
    colours: NDArray[np.float32]
    reach: NDArray[np.float32]
    gloss: NDArray[np.float64]

    def __post_init__(self) -> None:
        shapes = self.density.shape, self.axes.shape, self.colours.shape, self.reach.shape, self.gloss.shape
        nodes = self.lattice.shape
        if shapes != (nodes, (*nodes, 3), (*nodes, COLOURS), nodes, (len(GLOSS),)):
            raise InputError(f"density, axes, colours, reach and gloss have the shapes {shapes}, nodes {nodes}")

    @staticmethod
    def of_hull(lattice: Lattice, hull: NDArray[np.floating]) -> FuzzyShape:
        """Thin grey matter in a hull, whose fibres stand out from it."""
        reach = redistanced(hull)
        outwards = np.stack(np.gradient(reach)[::-1], axis=3)
        length = np.linalg.norm(outwards, axis=3, keepdims=True)
        axes = np.where(length > 1e-6, outwards / np.maximum(length, 1e-6), [0.0, 0.0, 1.0]).astype(np.float32)
        density = np.maximum(FIRST_DEPTH * np.clip(0.5 - reach, 0.0, 1.0), LEAST) * (reach < 1.0)
        grey = np.full((*hull.shape, COLOURS), GREY, np.float32)
        return FuzzyShape(lattice, density.astype(np.float32), axes, grey, reach, coordinates(*START))

    def field(self) -> DensityField:
        """It on the device."""
        return DensityField(self.density, self.axes, self.colours, self.reach)

    def after(self, field: MatterField, gloss: NDArray[np.float64]) -> FuzzyShape:
        """What a descent from it has made of its field and gloss."""
        assert isinstance(field, DensityField)
        return replace(
            self, density=field.densities(), axes=field.tangents(), colours=field.body_colours(), gloss=gloss
        )

    def finer(self, side: int) -> FuzzyShape:
        """The same on a lattice of `side` nodes around what is not empty: there may be matter only near it."""
        full = (self.density > THIN) & (self.reach < 1.0)
        if not full.any():
            raise InputError("no matter is left: the photographs show nothing that keeps light from what is behind it")
        left = signed_distance(way_to(full) <= KEPT_AROUND)
        lattice = self.lattice.around_surface(left, side)
        ratio = lattice.voxel / self.lattice.voxel
        reach = self.lattice.resampled(np.maximum(left, self.reach), lattice) / ratio
        axes = self.lattice.resampled(self.axes, lattice)
        axes /= np.maximum(np.linalg.norm(axes, axis=3, keepdims=True), 1e-6)
        density = np.maximum(self.lattice.resampled(self.density, lattice) * ratio, LEAST) * (reach < 1.0)
        colours = self.lattice.resampled(self.colours, lattice)
        return FuzzyShape(lattice, density.astype(np.float32), axes, colours, reach.astype(np.float32), self.gloss)

    def surface(self) -> SurfaceShape:
        """The surface that stands for the matter: there the clearest way out has the optical depth HALF_DEPTH.

        Where nothing is so opaque, it is that of half of the largest one.
        """
        depth = clearest_way_out(self.density)
        level = min(HALF_DEPTH, 0.5 * float(depth.max()))
        slope = np.sqrt(sum(each**2 for each in np.gradient(depth)))
        distance = np.clip((level - depth) / np.maximum(slope, STEEP), -REACH, REACH)
        return SurfaceShape(self.lattice, redistanced(distance), self.colours, self.gloss)


def clearest_way_out(density: NDArray[np.floating]) -> NDArray[np.float64]:
    """Optical depth (nz, ny, nx) from each node to the outside, the least of 26 directions: those to its neighbours."""
    padded = np.pad(np.asarray(density, np.float64), 1)
    least = np.full(density.shape, np.inf)
    for way in product((-1, 0, 1), repeat=3):
        if any(way):
            least = np.minimum(least, _depth_along(padded, way)[1:-1, 1:-1, 1:-1])
    return least


def _depth_along(density: NDArray[np.float64], way: tuple[int, ...]) -> NDArray[np.float64]:
    """Optical depth of each node along steps of `way` to the outside, by the trapezoidal rule; the edge is empty."""
    axis = next(k for k in range(3) if way[k])
    depth, length = np.zeros(density.shape), float(np.linalg.norm(way))
    layers, sums = np.moveaxis(density, axis, 0), np.moveaxis(depth, axis, 0)
    aside = tuple(-way[k] for k in range(3) if k != axis)
    order = range(1, len(layers)) if way[axis] < 0 else range(len(layers) - 2, -1, -1)
    for k in order:
        before = k + way[axis]
        reached = np.roll(sums[before] + 0.5 * length * layers[before], aside, axis=(0, 1))
        sums[k] = reached + 0.5 * length * layers[k]
    return depth
