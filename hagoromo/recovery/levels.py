"""Levels: an object is recovered on lattices from coarse to fine, each from the result of the one before."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from hagoromo.files.memory import require
from hagoromo.progress import Progress, part_of
from hagoromo.recovery.descent import DISTANCE_RATE, FIRST_RATE, Descent
from hagoromo.recovery.distance_field import COLOURS, DistanceField
from hagoromo.recovery.first_look import Look
from hagoromo.recovery.hull import redistanced, without_crumbs
from hagoromo.recovery.lamp_table import LampTable
from hagoromo.recovery.lattice import Lattice
from hagoromo.recovery.object_view import ObjectView
from hagoromo.recovery.pixel_table import CHUNK, PixelTable
from hagoromo.recovery.shading import START, coordinates

COARSEST = 32  # nodes along the longest edge of the first level
FOOTPRINT = 2.5  # pixels of a voxel's edge, at least, that pixels are not joined for
MODEL_ERROR, LAST_MODEL_ERROR = 0.02, 0.01  # relative error of the model, of coarse levels and of the last one
SOFTNESS, LAST_SOFTNESS = (1.0, 0.33), (0.6, 0.2)  # s at begin and end of a level, and of the last one [voxel]
BYTES_PER_PIXEL = 120.0  # of all arrays together
LEVEL_SHARE = 0.35  # of the steps of the last level, that a coarse one takes of the work
SPLINE = 2  # degree of the spline that distances are


@dataclass(frozen=True, eq=False)
class Shape:
    """An object on a lattice. distance: (nz, ny, nx) [voxel]. colours: (nz, ny, nx, 3). gloss: see `coordinates`."""

    lattice: Lattice
    distance: NDArray[np.float32]
    colours: NDArray[np.float32]
    gloss: NDArray[np.float64]

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


class Levels:
    """The way of an object from coarse to fine.

    views: what it is recovered from. start: on the lattice of the first level. sides: nodes along the longest edge of
    all levels. rays: of each step. seed: of the pixels that are drawn. look: the light where no lamp is known, and the
    turn of all cameras; both are fitted, too. `before`: the result of the level before.
    """

    def __init__(
        self,
        views: Sequence[ObjectView],
        start: Shape,
        sides: Sequence[int],
        rays: int,
        seed: int,
        shadows: bool,
        look: Look,
    ) -> None:
        self.views, self.sides, self.rays, self.seed, self.shadows = views, sides, rays, seed, shadows
        self.start, self.before, self.lattice, self.look = start, start, start.lattice, look
        self.descent: Descent | None = None

    @property
    def shape(self) -> Shape:
        """What there is."""
        if self.descent is None:
            return self.start
        field = self.descent.field
        return Shape(self.lattice, field.distances(), field.body_colours(), self.descent.gloss)

    def run(self, steps: int, progress: Progress) -> Descent:
        """Go through all levels; gives the descent of the last."""
        shares = np.array([LEVEL_SHARE] * (len(self.sides) - 1) + [1.0])
        ends = np.concatenate([[0.0], np.cumsum(shares / shares.sum())])
        for number, side in enumerate(self.sides):
            last = number == len(self.sides) - 1
            self.before = self.shape
            begin = self.before.finer(side) if number else self.start
            self.lattice, self.descent = begin.lattice, self._descent(begin, last)
            own = part_of(progress, float(ends[number]), float(np.diff(ends)[number]), f"{side} nodes")
            softness, rate = LAST_SOFTNESS if last else SOFTNESS, DISTANCE_RATE if number else FIRST_RATE
            self.descent.run(steps, self.rays // CHUNK, softness, rate, own)
        assert self.descent is not None  # there is a level
        return self.descent

    def _descent(self, begin: Shape, last: bool) -> Descent:
        """The descent of a level."""
        photographs, lattice = [view.photograph for view in self.views], begin.lattice
        nearest = min(float(np.linalg.norm(p.camera.position - lattice.middle)) for p in photographs)
        foot = lattice.voxel * max(min(p.camera.focal) for p in photographs) / nearest
        reduced = [view.reduced(max(1, int(foot / FOOTPRINT))) for view in self.views]
        require(BYTES_PER_PIXEL * sum(float(v.share.size) for v in reduced), "the pixels of all photographs")
        bright = [
            np.percentile(v.photograph.values[v.photograph.mask], 99.0) for v in reduced if v.photograph.mask.any()
        ]
        pixels = PixelTable(reduced, lattice, LAST_MODEL_ERROR if last else MODEL_ERROR, float(np.median(bright)))
        field, seed = DistanceField(begin.distance, begin.colours), self.seed + max(lattice.shape)
        return Descent(
            field, pixels, LampTable(photographs, lattice), begin.gloss, seed, self.shadows,
            self.look.unknown, self.look.turn,
        )  # fmt: skip


def sides_of(finest: int) -> list[int]:
    """Nodes along the longest edge of all levels: each has voxels of half the edge of the one before."""
    levels = [finest]
    while (levels[0] + 1) // 2 >= COARSEST:
        levels.insert(0, (levels[0] + 1) // 2)
    return levels
