"""Medium: the volume boxes of a scene as kernels see them, and the order in which a ray meets their samples.

Every box is walked on samples of its own, half a voxel apart; where boxes overlap the sample next in depth goes
first, so extinctions add. A sample of more than a certain optical depth is taken in parts instead.

    crossing = medium.cross(origin, direction, near, far)
    taken = crossing.start()
    while crossing.unfinished(taken):
        step = medium.next(crossing, taken)                # the next sample in depth, and the brick it lies in
        if step.brick < 0:  taken = crossing.leave(step, taken)      # to the end of the empty space around
        else:               depth = step.tau * medium.density(step) * step.length
                            if ~crossing.too_coarse(taken, depth):  ...
                            taken = crossing.after(step, depth, taken)
        taken = crossing.exchange(taken)         # the next box, where one has been left
        taken = crossing.exchange(taken)

Grids are held here, in a plain object, so that loops do not take them into their state.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import drjit as dr
import numpy as np

from hagoromo.backend import arrays, clip, lookup
from hagoromo.volume.box import VolumeBox
from hagoromo.volume.bricks import Bricks, Grid, in_one_pool
from hagoromo.volume.crossing import EDGE, Crossing, Step, Taken
from hagoromo.volume.frames import TOLERANCE, Frames
from hagoromo.volume.table import BLOCK, BRICKS
from hagoromo.volume.voxels import BRICK, STORED, PackedVoxels, Voxels, corner, packets

ABSENT = -(2**31)  # shift of a box that has no such grid


class Medium:
    """The boxes of a scene on the device; `tolerance` sets the steps of the march."""

    def __init__(self, boxes: Sequence[VolumeBox], tolerance: float = TOLERANCE) -> None:
        kinds, self.boxes = arrays(), tuple(boxes)
        for name in ("density", "axis", "colour", "material"):
            in_one_pool([grid for box in self.boxes if (grid := getattr(box.bricks, name)) is not None])
        bricks = list({id(box.bricks): box.bricks for box in self.boxes}.values())
        coarse, fine, first = _tables(bricks)
        self.coarse, self.fine = lookup(kinds.Int, coarse), lookup(kinds.Int, fine)
        self.voxels: Voxels = PackedVoxels(bricks[0].density.values, bricks[0].axis.values)
        self.colours, self.colour_shift = self._optional("colour")
        self.materials, self.material_shift = self._optional("material")
        counts = np.cumsum([0, *(len(box.materials) for box in self.boxes)])
        self.first_material = lookup(kinds.UInt, counts[:-1].astype(np.uint32))
        starts = [first[bricks.index(box.bricks)] for box in self.boxes]
        self.frames = Frames(self.boxes, starts, tolerance)
        self.tolerance = dr.opaque(kinds.Float, tolerance / TOLERANCE)  # in units of the usual one
        dr.eval(self.coarse, self.fine)

    def cross(
        self, origin: Any, direction: Any, near: Any, far: Any, phase: Any = 0.0, stride: float = 1.0
    ) -> Crossing:
        """Where rays (world, direction unit) are inside each box between the distances `near` and `far` [m].

        phase: part of a step, 0…1, by which the first one is shortened; pictures averaged over it show no rings.
        stride: length of a step in usual ones.
        """
        return Crossing(self.frames, (origin, direction, near, far), phase, stride)

    def next(self, crossing: Crossing, taken: Taken) -> Step:
        """The sample next in depth over all boxes."""
        kinds = arrays()
        slot, distance, length, ray = crossing.nearest(taken)
        whole = length
        length = length / kinds.Float(taken.parts)
        distance = dr.fma(kinds.Float(taken.part) + 0.5, length, dr.fma(whole, -0.5, distance))
        place = dr.fma(ray.direction, distance, ray.origin)
        place = type(place)(*(clip(place[k], 0.0, ray.last[k] - EDGE) for k in range(3)))
        cell = kinds.Array3i(place) >> 3
        block, inner = cell >> 3, cell & (BLOCK - 1)
        outer = dr.gather(
            kinds.Int, self.coarse, kinds.UInt(ray.first + block.z * ray.layer + block.y * ray.row + block.x)
        )
        place_in_block = (inner.z * BLOCK + inner.y) * BLOCK + inner.x
        held = outer >= 0
        brick = dr.gather(kinds.Int, self.fine, kinds.UInt(outer * BRICKS + place_in_block), held)
        return Step(slot, ray.box, ray.tau, distance, length, place, dr.select(held, brick, outer))

    def density(self, step: Step) -> Any:
        """Density at a sample in a kept brick."""
        return self.voxels.density(arrays().UInt(step.brick), step.place)

    def axis(self, step: Step) -> Any:
        """Unit axis, in the world, at a sample in a kept brick."""
        axis = self.voxels.axis(arrays().UInt(step.brick), step.place)
        x, y, z = self.frames.rotation(step.box)
        return dr.normalize(axis.x * x + axis.y * y + axis.z * z + 1e-9)

    def colour(self, step: Step) -> Any:
        """Coefficients of the body colour at a sample in a kept brick of a box that has them."""
        assert self.colours is not None
        return packets(self.colours, self._brick_in(self.colour_shift, step), step.place)

    def material(self, step: Step) -> Any:
        """Number of the sample's material in the row of all boxes' materials, that of the nearest voxel."""
        UInt = arrays().UInt
        first = dr.gather(UInt, self.first_material, step.box)
        if self.materials is None:
            return first
        start, part = corner(self._brick_in(self.material_shift, step), step.place)
        nearest = dr.select(part > 0.5, arrays().Array3u(1), arrays().Array3u(0))
        offset = (nearest.z * STORED + nearest.y) * STORED + nearest.x
        has = dr.gather(arrays().Int, self.material_shift, step.box) != ABSENT
        return first + UInt(dr.gather(arrays().UInt8, self.materials, start + offset, has))

    def _brick_in(self, shift: Any, step: Step) -> Any:
        """Number of the sample's brick in a grid that not every box has; 0 where it has none."""
        kinds = arrays()
        shift = dr.gather(kinds.Int, shift, step.box)
        return kinds.UInt(dr.select(shift == ABSENT, 0, step.brick + shift))

    def _optional(self, name: str) -> tuple[Any, Any]:
        """A grid that some boxes have (None: no box), and per box how its brick numbers differ there."""
        grids: list[Grid | None] = [getattr(box.bricks, name) for box in self.boxes]
        values = next((grid.values for grid in grids if grid is not None), None)
        shifts = [
            ABSENT if grid is None else grid.first - box.bricks.density.first
            for grid, box in zip(grids, self.boxes, strict=True)
        ]
        return values, lookup(arrays().Int, np.array(shifts, np.int32))


def _tables(bricks: list[Bricks]) -> tuple[np.ndarray, np.ndarray, list[int]]:
    """Tables of several lattices as one, brick numbers counted in their common pool; where each coarse one starts."""
    coarse, fine, first, blocks = [], [], [0], 0
    for part in bricks:
        table = part.table
        coarse.append(np.where(table.coarse >= 0, table.coarse + blocks, table.coarse).ravel())
        fine.append(np.where(table.fine >= 0, table.fine + part.density.first, table.fine).ravel())
        blocks += len(table.fine)
        first.append(first[-1] + table.coarse.size)
    fine.append(np.full(1, -BRICK, np.int32))  # a table without blocks is never read, but must not be empty
    return np.concatenate(coarse), np.concatenate(fine), first[:-1]
