"""Shape: a distance, body colours and a gloss on a lattice, as plain arrays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from hagoromo.errors import InputError
from hagoromo.recovery.distance_field import COLOURS
from hagoromo.recovery.hull import redistanced, without_crumbs
from hagoromo.recovery.lattice import Lattice
from hagoromo.recovery.shading import GLOSS, START, coordinates

SPLINE = 2  # degree of the spline that distances are


@dataclass(frozen=True, eq=False)
class Shape:
    """An object on a lattice. distance: (nz, ny, nx) [voxel]. colours: (nz, ny, nx, 3). gloss: see `coordinates`."""

    lattice: Lattice
    distance: NDArray[np.float32]
    colours: NDArray[np.float32]
    gloss: NDArray[np.float64]

    def __post_init__(self) -> None:
        shapes = self.distance.shape, self.colours.shape, self.gloss.shape
        if shapes != (self.lattice.shape, (*self.lattice.shape, COLOURS), (len(GLOSS),)):
            raise InputError(f"distances, colours and gloss have the shapes {shapes}, nodes {self.lattice.shape}")

    @staticmethod
    def of_hull(lattice: Lattice, hull: NDArray[np.floating]) -> Shape:
        """That of a hull: grey, and of usual gloss."""
        grey = np.full((*hull.shape, COLOURS), 0.4, np.float32)
        return Shape(lattice, redistanced(hull), grey, coordinates(*START))

    def finer(self, side: int) -> Shape:
        """The same on a lattice of `side` nodes around it: there distances have the values of the spline they are."""
        own = np.asarray(without_crumbs(self.distance), np.float64)
        lattice = self.lattice.around_surface(own, side)
        at = np.moveaxis(self.lattice.from_world(lattice.nodes())[..., ::-1], 3, 0)
        values = ndimage.map_coordinates(own, at, order=SPLINE, mode="nearest", prefilter=False)
        distance = np.asarray(ndimage.spline_filter(values * (self.lattice.voxel / lattice.voxel), order=SPLINE))
        colours = [ndimage.map_coordinates(self.colours[..., c], at, order=1, mode="nearest") for c in range(COLOURS)]
        return Shape(lattice, distance.astype(np.float32), np.stack(colours, axis=3).astype(np.float32), self.gloss)
