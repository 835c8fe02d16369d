"""Medium: the volume boxes of a scene as rays meet them, on the device.

Every box is walked on samples of its own, half a voxel apart; where boxes overlap the sample next in depth goes
first, so extinctions add. A sample whose optical depth is above COARSE is taken in parts of about FINE instead. A
ray's `Crossing` of the boxes and its `Taken` (the next sample in each box, and its part) are all that a loop needs:

    crossing = medium.cross(origin, direction, near, far)
    taken = crossing.start()
    while crossing.unfinished(taken):
        step = medium.next(crossing, taken)                # the next sample in depth, and the brick it lies in
        if step.brick < 0:  taken = crossing.leave(step, taken)      # to the end of the empty space around
        else:               depth = step.tau * medium.voxel(step)[0] * step.length
                            if ~step.too_coarse(depth):  ...
                            taken = crossing.after(step, depth, taken)

Grids are held here, in a plain object, so that loops do not take them into their state.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import drjit as dr
import numpy as np

from hagoromo.backend import arrays, clip, opaque_vector
from hagoromo.volume.box import VolumeBox
from hagoromo.volume.bricks import BRICK, STORED, VOXELS

STEPS_PER_VOXEL = 2.0
FINE, COARSE = 0.35, 0.7  # optical depth of a sample: what parts aim at, and what is taken apart
MOST_PARTS = 32
EDGE = 1e-3  # the last interpolation cell ends this much before the last voxel centre [voxel]


class Frame(NamedTuple):
    """One box as numbers that kernels read (opaque: another pose or voxel size does not compile anew)."""

    columns: tuple[Any, Any, Any]  # lattice_from_world: directions
    shift: Any  # and offset
    last: Any  # nx−1, ny−1, nz−1
    row: Any  # bricks along x
    layer: Any  # bricks along x times along y
    first: Any  # where its table starts
    tau: Any
    step: Any  # [m]
    rotation: tuple[Any, Any, Any]  # box axes in the world, as columns


@dataclass
class Taken:
    """How far rays are: the next sample in each box, and which part of how many of it comes next."""

    numbers: list[Any]
    part: Any
    parts: Any


@dataclass
class Step:
    """A sample: which box, its number, part, middle and length [m], and where it is on the lattice."""

    box: Any
    number: Any
    part: Any
    parts: Any
    distance: Any
    length: Any
    place: Any  # lattice coordinates, inside [0, n−1)
    brick: Any  # entry of the table
    tau: Any

    def too_coarse(self, depth: Any) -> Any:
        """Whether the sample, of optical depth `depth`, is to be taken again in (more) parts."""
        return (depth > COARSE) & (self.part == 0) & (self.parts < MOST_PARTS)

    def centroid(self, depth: Any) -> Any:
        """Distance [m] of the centroid of exp(−σs) over the sample: its middle in thin matter, its front in dense."""
        thick = dr.fmax(depth, 1e-2)
        share = dr.select(depth > 1e-2, 1.0 / thick - 1.0 / (dr.exp(thick) - 1.0), 0.5 - depth / 12.0)
        return dr.fma(self.length, share - 0.5, self.distance)


class Medium:
    """The boxes of a scene on the device; `steps_per_voxel` sets the sampling of the march."""

    def __init__(self, boxes: Sequence[VolumeBox], steps_per_voxel: float = STEPS_PER_VOXEL) -> None:
        kinds, self.boxes = arrays(), tuple(boxes)
        tables, offset, first = [], 0, [0]
        for box in self.boxes:
            table = box.bricks.table.ravel()
            tables.append(np.where(table >= 0, table + offset, table))
            offset += max(box.bricks.kept, 1)  # an empty box holds one brick of zeros
            first.append(first[-1] + table.size)
        self.table = kinds.Int(np.concatenate(tables).astype(np.int32))
        self.voxels = _joined([box.bricks.voxels for box in self.boxes])
        self.colours = self._grid("colour", 4)
        self.materials = self._grid("material", 1)
        counts = [len(box.materials) for box in self.boxes]
        self.first_material = [int(n) for n in np.cumsum([0, *counts[:-1]])]
        self.frames = [_frame(box, start, steps_per_voxel) for box, start in zip(self.boxes, first, strict=False)]
        dr.eval(self.table, self.voxels, self.colours, self.materials)

    def cross(self, origin: Any, direction: Any, near: Any, far: Any, phase: Any = 0.0) -> Crossing:
        """Where rays (world, direction unit) are inside each box between the distances `near` and `far` [m].

        phase: part of a step, 0…1, by which the first one is shortened; pictures averaged over it show no rings.
        """
        return Crossing(self.frames, origin, direction, near, far, phase)

    def next(self, crossing: Crossing, taken: Taken) -> Step:
        """The sample next in depth over all boxes."""
        box, number, distance, length, ray, frame = crossing.nearest(taken.numbers)
        whole = length
        length = length / arrays().Float(taken.parts)
        distance = dr.fma(arrays().Float(taken.part) + 0.5, length, dr.fma(whole, -0.5, distance))
        last = frame.last - EDGE
        place = dr.fma(ray.direction, distance, ray.origin)
        place = type(place)(*(clip(place[k], 0.0, last[k]) for k in range(3)))
        cell = arrays().Array3i(place) >> 3
        brick = dr.gather(
            arrays().Int, self.table, arrays().UInt(frame.first + cell.z * frame.layer + cell.y * frame.row + cell.x)
        )
        return Step(box, number, taken.part, taken.parts, distance, length, place, brick, frame.tau)

    def voxel(self, step: Step, grid: Any = None) -> Any:
        """Trilinear voxel of a sample in a kept brick: density and axis in box axes (or colours, from another grid)."""
        kinds, grid = arrays(), self.voxels if grid is None else grid
        packets = kinds.Array4f16 if type(grid) is kinds.Float16 else kinds.Array4f
        start, part = self.corner(step)
        total: Any = None
        for z in (0, 1):
            for y in (0, 1):
                across = (part.z if z else 1.0 - part.z) * (part.y if y else 1.0 - part.y)
                for x in (0, 1):
                    weight = across * (part.x if x else 1.0 - part.x)
                    packet = kinds.Array4f(dr.gather(packets, grid, start + ((z * STORED + y) * STORED + x)))
                    total = weight * packet if total is None else dr.fma(weight, packet, total)
        return total

    def corner(self, step: Step) -> tuple[Any, Any]:
        """Index of the first of the eight voxels around a sample, and where it is between them (0…1)."""
        kinds = arrays()
        cell = kinds.Array3u(step.place)
        inner = cell & (BRICK - 1)
        start = kinds.UInt(step.brick) * VOXELS + (inner.z * STORED + inner.y) * STORED + inner.x
        return start, step.place - kinds.Array3f(cell)

    def material(self, step: Step) -> Any:
        """Number of the sample's material in the row of all boxes' materials, that of the nearest voxel."""
        UInt = arrays().UInt
        first = _choose(step.box, [UInt(n) for n in self.first_material])
        if self.materials is None:
            return first
        start, part = self.corner(step)
        nearest = dr.select(part > 0.5, arrays().Array3u(1), arrays().Array3u(0))
        return first + dr.gather(UInt, self.materials, start + (nearest.z * STORED + nearest.y) * STORED + nearest.x)

    def axis_in_world(self, step: Step, axis: Any) -> Any:
        """A unit axis of the box that holds the sample, turned into the world."""
        turned = [_choose(step.box, [frame.rotation[k] for frame in self.frames]) for k in range(3)]
        return dr.normalize(axis.x * turned[0] + axis.y * turned[1] + axis.z * turned[2] + 1e-9)

    def _grid(self, name: str, per_voxel: int) -> Any:
        """One grid of all boxes, zeros for those that have none; None when no box has one."""
        parts = [getattr(box.bricks, name) for box in self.boxes]
        kind = next((type(part) for part in parts if part is not None), None)
        if kind is None:
            return None
        sizes = [max(box.bricks.kept, 1) * VOXELS * per_voxel for box in self.boxes]
        return _joined([dr.zeros(kind, n) if part is None else part for part, n in zip(parts, sizes, strict=True)])


class Ray(NamedTuple):
    """A ray on one box's lattice."""

    origin: Any
    direction: Any
    near: Any
    far: Any
    end: Any  # number of samples
    step: Any


class Crossing:
    """Rays on the lattices of all boxes, and the order in which they meet their samples."""

    def __init__(self, frames: list[Frame], origin: Any, direction: Any, near: Any, far: Any, phase: Any) -> None:
        self.frames, self.phase = frames, phase
        self.rays = [_ray(frame, origin, direction, near, far, phase) for frame in frames]

    def start(self) -> Taken:
        """Before the first sample of every box."""
        UInt, rays = arrays().UInt, dr.width(self.rays[0].end)
        return Taken([dr.zeros(UInt, rays) for _ in self.rays], dr.zeros(UInt, rays), dr.ones(UInt, rays))

    def unfinished(self, taken: Taken) -> Any:
        """Whether a sample is left in any box."""
        left = taken.numbers[0] < self.rays[0].end
        for number, ray in zip(taken.numbers[1:], self.rays[1:], strict=True):
            left |= number < ray.end
        return left

    def nearest(self, taken: list[Any]) -> tuple[Any, Any, Any, Any, Ray, Frame]:
        """Box, number, distance of the middle, length, ray and frame of the sample next in depth."""
        box, number, (distance, length) = arrays().UInt(0), taken[0], self._sample(0, taken[0])
        ray, frame = self.rays[0], self.frames[0]
        for k in range(1, len(self.rays)):
            other, other_length = self._sample(k, taken[k])
            first = other < distance
            box, number = dr.select(first, k, box), dr.select(first, taken[k], number)
            distance, length = dr.select(first, other, distance), dr.select(first, other_length, length)
            ray, frame = _select(first, self.rays[k], ray), _select(first, self.frames[k], frame)
        return box, number, distance, length, ray, frame

    def leave(self, step: Step, taken: Taken) -> Taken:
        """On to the first sample beyond the empty bricks around the one that the sample lies in."""
        ray = self.rays[0]
        for k in range(1, len(self.rays)):
            ray = _select(step.box == k, self.rays[k], ray)
        kinds, reach = arrays(), -step.brick - 1
        cell = kinds.Array3i(step.place) >> 3
        face = dr.select(ray.direction > 0.0, cell + 1 + reach, cell - reach) * BRICK
        distance = dr.min((kinds.Array3f(face) - ray.origin) / ray.direction)
        samples = dr.ceil((distance - ray.near) / ray.step + (self.phase - 0.5))
        number = dr.maximum(step.number + 1, kinds.UInt(dr.fmax(samples, 0.0)))
        return Taken(self._at(step, number, taken), kinds.UInt(0), kinds.UInt(1))

    def on(self, step: Step, taken: Taken) -> Taken:
        """On to the next whole sample."""
        return Taken(self._at(step, step.number + 1, taken), arrays().UInt(0), arrays().UInt(1))

    def after(self, step: Step, depth: Any, taken: Taken) -> Taken:
        """On from a sample of optical depth `depth`: again in parts, to its next part, or to the next sample."""
        UInt = arrays().UInt
        whole = dr.ceil(depth * arrays().Float(step.parts) / FINE)
        parts = dr.maximum(UInt(dr.fmin(whole, MOST_PARTS)), 1)
        again, last = step.too_coarse(depth), step.part + 1 >= step.parts
        part = dr.select(again | last, UInt(0), step.part + 1)
        number = dr.select(last & ~again, step.number + 1, step.number)
        return Taken(self._at(step, number, taken), part, dr.select(again | last, parts, step.parts))

    def _at(self, step: Step, number: Any, taken: Taken) -> list[Any]:
        """The numbers once the box of `step` stands at `number`."""
        if len(taken.numbers) == 1:
            return [number]
        return [dr.select(step.box == k, number, old) for k, old in enumerate(taken.numbers)]

    def _sample(self, k: int, number: Any) -> tuple[Any, Any]:
        """Middle and length of a sample; behind all others once the box is done. The first and last may be shorter."""
        ray = self.rays[k]
        before = arrays().Float(number) - self.phase
        begin = dr.fma(dr.fmax(before, 0.0), ray.step, ray.near)
        length = dr.fmin(dr.fma(before + 1.0, ray.step, ray.near), ray.far) - begin
        middle = dr.fma(length, 0.5, begin)
        return (middle if len(self.rays) == 1 else dr.select(number < ray.end, middle, math.inf)), length


def _frame(box: VolumeBox, first: int, steps_per_voxel: float) -> Frame:
    kinds = arrays()
    lattice, rotation = box.lattice_from_world, np.asarray(box.pose, float)[:3, :3]
    nz, ny, nx = box.bricks.shape
    _, my, mx = box.bricks.table.shape

    def number(kind: Any, value: float) -> Any:
        return dr.opaque(kind, value)

    x, y, z = (opaque_vector(lattice[:3, k]) for k in range(3))
    a, b, c = (opaque_vector(rotation[:, k]) for k in range(3))
    return Frame(
        (x, y, z), opaque_vector(lattice[:3, 3]), opaque_vector((nx - 1, ny - 1, nz - 1)),
        number(kinds.Int, mx), number(kinds.Int, mx * my), number(kinds.Int, first),
        number(kinds.Float, box.tau), number(kinds.Float, box.voxel_size / steps_per_voxel), (a, b, c),
    )  # fmt: skip


def _ray(frame: Frame, origin: Any, direction: Any, near: Any, far: Any, phase: Any) -> Ray:
    kinds, (x, y, z) = arrays(), frame.columns
    start = origin.x * x + origin.y * y + origin.z * z + frame.shift
    along = direction.x * x + direction.y * y + direction.z * z
    along = dr.select(dr.abs(along) < 1e-9, 1e-9, along)  # a ray within a lattice plane: no 0/0 below
    faces = (-0.5 - start) / along, (frame.last + 0.5 - start) / along
    enter = dr.fmax(dr.max(kinds.Array3f(*map(dr.fmin, *faces))), near)
    leave = dr.fmin(dr.min(kinds.Array3f(*map(dr.fmax, *faces))), far)
    samples = dr.ceil((leave - enter) / frame.step + (phase - EDGE))
    met = (leave > enter) & dr.isfinite(leave)  # false, too, for a ray that is not finite
    return Ray(start, along, enter, leave, kinds.UInt(dr.select(met, dr.fmax(samples, 0.0), 0.0)), frame.step)


def _select(mask: Any, yes: Any, no: Any) -> Any:
    """`dr.select` through (nested) named tuples."""
    if isinstance(yes, tuple):
        parts = [_select(mask, a, b) for a, b in zip(yes, no, strict=True)]
        return type(yes)(*parts) if hasattr(yes, "_fields") else tuple(parts)
    return dr.select(mask, yes, no)


def _choose(index: Any, choices: list[Any]) -> Any:
    chosen = choices[0]
    for k in range(1, len(choices)):
        chosen = dr.select(index == k, choices[k], chosen)
    return chosen


def _joined(parts: list[Any]) -> Any:
    return parts[0] if len(parts) == 1 else dr.concat(parts)
