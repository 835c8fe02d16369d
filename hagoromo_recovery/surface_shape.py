"""Surface shape: a distance, body colours and a gloss on a lattice, as plain arrays."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from hagoromo.errors import InputError
from hagoromo_recovery.field.distance_field import DistanceField
from hagoromo_recovery.field.matter_field import COLOURS, MatterField
from hagoromo_recovery.outline.hull import redistanced, without_crumbs
from hagoromo_recovery.outline.lattice import Lattice
from hagoromo_recovery.shading.shading import GLOSS, START, TWO_GLOSSES, coordinates, order_of, two_glosses

GREY = 0.3  # body colour of a hull: that of `colour_unit.USUAL`; from a brighter one steps end worse
SPLINE = 2  # degree of the spline that distances are


@dataclass(frozen=True, eq=False)
class SurfaceShape:
    """An object on a lattice. distance: (nz, ny, nx) [voxel]. colours: (nz, ny, nx, 3). gloss: see `coordinates`.

    shares: (nz, ny, nx) of the second of two glosses, 0 … 1; None: one gloss everywhere.
    """

    lattice: Lattice
    distance: NDArray[np.float32]
    colours: NDArray[np.float32]
    gloss: NDArray[np.float64]
    shares: NDArray[np.float32] | None = None

    def __post_init__(self) -> None:
        shapes = self.distance.shape, self.colours.shape, self.gloss.shape
        nodes, count = self.lattice.shape, len(GLOSS) if self.shares is None else len(TWO_GLOSSES)
        if shapes != (nodes, (*nodes, COLOURS), (count,)):
            raise InputError(f"distances, colours and gloss have the shapes {shapes}, nodes {nodes}")
        if self.shares is not None and self.shares.shape != nodes:
            raise InputError(f"shares of glosses have the shape {self.shares.shape}, nodes {nodes}")

    @staticmethod
    def of_hull(lattice: Lattice, hull: NDArray[np.floating]) -> SurfaceShape:
        """That of a hull: grey, and of usual gloss."""
        grey = np.full((*hull.shape, COLOURS), GREY, np.float32)
        return SurfaceShape(lattice, redistanced(hull), grey, coordinates(*START))

    def with_two_glosses(self) -> SurfaceShape:
        """The same with two glosses, of which each node has half."""
        return replace(self, gloss=two_glosses(self.gloss), shares=np.full(self.distance.shape, 0.5, np.float32))

    def in_order(self) -> SurfaceShape:
        """The same, the narrower of two glosses first."""
        order = order_of(self.gloss)
        if self.shares is None or order[0] == 0:
            return self
        return replace(self, gloss=self.gloss[order], shares=1.0 - self.shares)

    def field(self) -> DistanceField:
        """It on the device."""
        return DistanceField(self.distance, self.colours, self.shares)

    def after(self, field: MatterField, gloss: NDArray[np.float64]) -> SurfaceShape:
        """What a descent from it has made of its field and gloss."""
        assert isinstance(field, DistanceField)
        return SurfaceShape(self.lattice, field.distances(), field.body_colours(), gloss, field.gloss_shares())

    def surface(self) -> SurfaceShape:
        """It is one."""
        return self

    def finer(self, side: int) -> SurfaceShape:
        """The same on a lattice of `side` nodes around it: there distances have the values of the spline they are."""
        own = np.asarray(without_crumbs(self.distance), np.float64)
        lattice = self.lattice.around_surface(own, side)
        at = np.moveaxis(self.lattice.from_world(lattice.nodes())[..., ::-1], 3, 0)
        values = ndimage.map_coordinates(own, at, order=SPLINE, mode="nearest", prefilter=False)
        distance = np.asarray(ndimage.spline_filter(values * (self.lattice.voxel / lattice.voxel), order=SPLINE))
        colours = self.lattice.resampled(self.colours, lattice)
        shares = None if self.shares is None else self.lattice.resampled(self.shares, lattice)
        return SurfaceShape(lattice, distance.astype(np.float32), colours, self.gloss, shares)
