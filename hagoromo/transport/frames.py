"""Frames: pose, lattice and step of each volume box as rows of numbers that kernels read."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import Array3f, Float, Int, UInt, arrays, lookup, opaque_vector
from hagoromo.transport.textures import Textures
from hagoromo.volume.box import VolumeBox
from hagoromo.volume.table import blocks_shape

DEFAULT_TOLERANCE = 0.04  # relative RMSE of an image where there is matter [1]
LONGEST_STEP = 1.5  # [voxel] at DEFAULT_TOLERANCE
DEEPEST_STEP = 0.7  # optical depth of a step, at DEFAULT_TOLERANCE
DENSEST = 64.0  # largest extinction [1/voxel]: matter this dense is opaque within a small part of a voxel
ROW_FLOATS = 32  # per box: 4 × 3 lattice from world, 3 last voxel, tau, step, 3 × 3 rotation, 2 × 3 bounds of matter


Poses: TypeAlias = NDArray[np.float64]


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
    """The frames of all boxes. slots: number of boxes that a ray may be in at once.

    instant: of boxes that move, the number of the poses that rays have (UInt); whoever traces them sets it.
    """

    def __init__(
        self, boxes: Sequence[VolumeBox], starts: Sequence[int], tolerance: float, poses: Poses | None = None
    ) -> None:
        """`tolerance`, of a picture, limits depth and length of steps in all boxes, by its square root. poses: of boxes
        that move, (instants, boxes, 4, 4), in place of their own; for walks, which need no slots.
        """
        jit, finer = arrays(), math.sqrt(tolerance / DEFAULT_TOLERANCE)
        self.textures: Textures | None = None
        if any(box.texel for box in boxes):
            self.textures = Textures([(box.texel, box.band, box.voxel_size) for box in boxes], finer)
        self.deepest = dr.opaque(jit.Float, DEEPEST_STEP * finer)
        self.count, self.slots = len(boxes), most_at_once(boxes)
        self.instant: UInt | None = None
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
        if poses is not None:
            floats = _at_instants(floats, boxes, poses)
        self.floats, self.whole = lookup(jit.Float, floats), lookup(jit.Int, whole)
        self.boxes = dr.opaque(jit.UInt, len(boxes))
        self.only: tuple[BoxFrame, list[Array3f]] | None = None
        if self.count == 1 and poses is None:  # numbers common to all rays cost no reads
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
        tau, step = (dr.gather(jit.Float, self.floats, self._row(box) + k) for k in (15, 16))
        row, layer, first = (dr.gather(jit.Int, self.whole, box * 3 + k) for k in range(3))
        bounds = self._vector(box, 26), self._vector(box, 29)
        return BoxFrame([x, y, z], shift, last, bounds, tau, step, row, layer, first)

    def rotation(self, box: UInt) -> list[Array3f]:
        """Axes of box number `box` in the world."""
        return self.only[1] if self.only else [self._vector(box, k) for k in (17, 20, 23)]

    def _vector(self, box: UInt, first: int) -> Array3f:
        jit = arrays()
        return jit.Array3f(*(dr.gather(jit.Float, self.floats, self._row(box) + first + k) for k in range(3)))

    def _row(self, box: UInt) -> UInt:
        return (box if self.instant is None else self.instant * self.boxes + box) * ROW_FLOATS


def _at_instants(floats: NDArray[np.float32], boxes: Sequence[VolumeBox], poses: Poses) -> NDArray[np.float32]:
    """The rows of boxes, (instants · boxes, ROW_FLOATS), with their poses at each instant."""
    rows = np.repeat(floats[None], len(poses), axis=0)
    for k, box in enumerate(boxes):
        lattice = np.diag([*[1.0 / box.voxel_size] * 3, 1.0])
        lattice[:3, 3] = -0.5
        rows[:, k, :12] = (lattice @ np.linalg.inv(poses[:, k]))[:, :3].transpose(0, 2, 1).reshape(-1, 12)
        rows[:, k, 17:26] = poses[:, k, :3, :3].transpose(0, 2, 1).reshape(-1, 9)
    return rows.reshape(-1, ROW_FLOATS)


def most_at_once(boxes: Sequence[VolumeBox]) -> int:
    """Upper bound on the number of boxes that share a point, by overlaps of their axis-aligned bounds."""
    corners = np.stack([box.matter_corners() for box in boxes])
    low, high = corners.min(axis=1), corners.max(axis=1)
    touch = 1e-6 * np.linalg.norm(np.ptp(corners.reshape(-1, 3), axis=0))
    overlap = ((low[:, None] + touch < high[None]) & (low[None] + touch < high[:, None])).all(axis=-1)
    return int(overlap.sum(axis=1).max())
