"""Frames: pose, lattice and step of each volume box as rows of numbers that kernels read."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import drjit as dr
import numpy as np

from hagoromo.backend import Array3f, Float, Int, UInt, arrays, lookup, opaque_vector
from hagoromo.transport.textures import Textures
from hagoromo.volume.box import VolumeBox
from hagoromo.volume.table import blocks_shape

DEFAULT_TOLERANCE = 0.04  # relative RMSE of an image where there is matter [1]
LONGEST_STEP = 1.5  # [voxel] at DEFAULT_TOLERANCE
DEEPEST_STEP = 0.7  # optical depth of a step, at DEFAULT_TOLERANCE
DENSEST = 64.0  # largest extinction [1/voxel]: matter this dense is opaque within a small part of a voxel
ROW_FLOATS = 32  # per box: 4 × 3 lattice from world, 3 last voxel, tau, step, 3 × 3 rotation, 2 × 3 bounds of matter


@dataclass
class BoxFrame:
    """A box as numbers that kernels read: another pose or voxel size does not compile anew."""

    columns: list[Array3f]  # lattice_from_world: directions
    shift: Array3f  # and offset
    last: Array3f  # nx−1, ny−1, nz−1
    bounds: tuple[Array3f, Array3f]  # between which matter lies [voxel]
    tau: Float  # extinction per unit of density [1/m]
    step: Float  # greatest length [m]
    row: Int  # blocks along x
    layer: Int  # blocks along x times along y
    first: Int  # entry of the coarse table where the box starts


class Frames:
    """The frames of all boxes. slots: number of boxes that a ray may be in at once."""

    def __init__(self, boxes: Sequence[VolumeBox], starts: Sequence[int], tolerance: float) -> None:
        """`tolerance`, of a picture, limits depth and length of steps in all boxes, by its square root."""
        jit, finer = arrays(), math.sqrt(tolerance / DEFAULT_TOLERANCE)
        self.textures: Textures | None = None
        if any(box.texel for box in boxes):
            self.textures = Textures([(box.texel, box.band, box.voxel_size) for box in boxes], finer)
        self.deepest = dr.opaque(jit.Float, DEEPEST_STEP * finer)
        self.count, self.slots = len(boxes), most_at_once(boxes)
        floats = np.zeros((len(boxes), ROW_FLOATS), np.float32)
        whole = np.zeros((len(boxes), 3), np.int32)
        for row, numbers, box, start in zip(floats, whole, boxes, starts, strict=True):
            row[:12] = box.lattice_from_world[:3].T.ravel()
            row[12:15] = np.array(box.bricks.shape[::-1]) - 1
            row[15:17] = box.tau, box.voxel_size * LONGEST_STEP * finer
            row[26:32] = np.concatenate(box.matter_bounds)
            row[17:26] = np.asarray(box.pose, float)[:3, :3].T.ravel()
            _, my, mx = blocks_shape(box.bricks.lattice)
            numbers[:] = mx, mx * my, start
        self.floats, self.whole = lookup(jit.Float, floats), lookup(jit.Int, whole)
        self.boxes = dr.opaque(jit.UInt, len(boxes))
        self.only: tuple[BoxFrame, list[Array3f]] | None = None
        if self.count == 1:  # numbers common to all rays cost no reads
            x, y, z, shift, last = (opaque_vector(floats[0, k : k + 3]) for k in range(0, 15, 3))
            tau, step = (dr.opaque(jit.Float, float(v)) for v in floats[0, 15:17])
            row, layer, first = (dr.opaque(jit.Int, int(v)) for v in whole[0])
            rotation = [opaque_vector(floats[0, k : k + 3]) for k in (17, 20, 23)]
            bounds = opaque_vector(floats[0, 26:29]), opaque_vector(floats[0, 29:32])
            self.only = BoxFrame([x, y, z], shift, last, bounds, tau, step, row, layer, first), rotation
        dr.eval(self.floats, self.whole)

    def frame(self, box: UInt) -> BoxFrame:
        """The frame of box number `box` (UInt)."""
        if self.only:
            return self.only[0]
        jit = arrays()
        x, y, z, shift, last = (self._vector(box, k) for k in range(0, 15, 3))
        tau, step = (dr.gather(jit.Float, self.floats, box * ROW_FLOATS + k) for k in (15, 16))
        row, layer, first = (dr.gather(jit.Int, self.whole, box * 3 + k) for k in range(3))
        bounds = self._vector(box, 26), self._vector(box, 29)
        return BoxFrame([x, y, z], shift, last, bounds, tau, step, row, layer, first)

    def rotation(self, box: UInt) -> list[Array3f]:
        """Axes of box number `box` in the world."""
        return self.only[1] if self.only else [self._vector(box, k) for k in (17, 20, 23)]

    def _vector(self, box: UInt, first: int) -> Array3f:
        jit = arrays()
        return jit.Array3f(*(dr.gather(jit.Float, self.floats, box * ROW_FLOATS + first + k) for k in range(3)))


def most_at_once(boxes: Sequence[VolumeBox]) -> int:
    """Upper bound on the number of boxes that share a point, by overlaps of their axis-aligned bounds."""
    corners = np.stack([box.matter_corners() for box in boxes])
    low, high = corners.min(axis=1), corners.max(axis=1)
    touch = 1e-6 * np.linalg.norm(np.ptp(corners.reshape(-1, 3), axis=0))
    overlap = ((low[:, None] + touch < high[None]) & (low[None] + touch < high[:, None])).all(axis=-1)
    return int(overlap.sum(axis=1).max())
