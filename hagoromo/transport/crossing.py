"""Crossing: rays through volume boxes, and the order of their samples in depth.

Enters: rays in the world. Leaves: the next step of each. A ray has a slot for each box that it may be in at once; a box
that it has left gives its slot to the next. With a slot for every box, rays are set up once, before the march.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any

import drjit as dr

from hagoromo.backend import Array3f, Bool, Float, Int, UInt, arrays
from hagoromo.transport.frames import Frame, Frames

SPLIT_FACTOR = 2.0  # a sample is split where its optical depth exceeds this many times SUB_SAMPLE_DEPTH
MOST_SUB_SAMPLES = 32  # of one sample
CLEARANCE_SHARE = 0.8  # share of a clearance that one step may skip: it is interpolated, not exact
LATTICE_MARGIN = 1e-3  # [voxel] from the last voxel centre that samples keep, so that interpolation stays inside
Cone = tuple[Float, Float]  # footprint of a ray: its width at the origin [m], and the growth of that per metre [1]


@dataclass
class Ray:
    """A ray on the lattice of one box, with what its samples need of the box."""

    box: UInt
    origin: Array3f  # lattice coordinates [voxel]
    direction: Array3f  # [voxel/m]
    near: Float  # distance at which the ray enters the box [m]
    far: Float  # distance at which it leaves [m]
    sample_count: UInt
    step: Float  # length of a whole step [m]
    last: Array3f  # voxels along x, y, z, less 1
    tau: Float  # extinction per unit of density [1/m]
    row: Int  # blocks along x in the brick table
    layer: Int  # blocks along x times blocks along y
    first: Int  # entry of the coarse table where the box starts
    level: UInt  # row of the level of its texel, see `Textures`


@dataclass
class MarchState:
    """The next sample of each slot, and sub-sample `part` of `parts`.

    With more boxes than slots also the ray in each slot, and the box that was entered last.
    """

    numbers: list[UInt]  # of the next sample, one per slot
    part: UInt  # 0 … parts − 1
    parts: UInt  # sub-samples that the sample is split into
    rays: list[Ray]  # one per slot; empty where there is a slot for every box
    entered: Float  # distance at which the ray entered `box` [m]
    box: UInt  # number of the box entered last


@dataclass
class Step:
    """A step of the march and the sample at its middle.

    Every branch of a kernel carries it, so it has no field that can be derived from another.
    """

    slot: UInt  # of the ray that steps
    box: UInt
    tau: Float  # extinction per unit of density [1/m]
    distance: Float  # of the sample from the origin of the ray [m]
    length: Float  # of the step [m]
    place: Array3f  # of the sample in lattice coordinates [voxel], inside [0, n − 1)
    brick: Int  # ≥ 0: number of the stored brick; < 0: distance to the next one, see `BrickTable`
    level: UInt  # row of the level of its texel, see `Textures`

    def centroid(self, depth: Float) -> Float:
        """Distance [m] of the centroid of exp(−σs) over the step: its middle in thin matter, its front in dense."""
        thick = dr.fmax(depth, 1e-2)
        share = dr.select(depth > 1e-2, 1.0 / thick - 1.0 / (dr.exp(thick) - 1.0), 0.5 - depth / 12.0)
        return dr.fma(self.length, share - 0.5, self.distance)


class Crossing:
    """Rays on the lattices of all boxes."""

    def __init__(
        self, frames: Frames, rays: tuple[Array3f, Array3f, Float, Float], phase: Float, stride: float, cone: Cone
    ) -> None:
        """`rays`: origin, direction (Array3f), near and far [m]; `phase`, `stride`, `cone`: see `Medium.cross`."""
        self.frames, self.phase, self.stride, self.cone = frames, phase, stride, cone
        self.origin, self.direction, self.near, self.far = rays
        self.exchanged = frames.count > frames.slots
        self.rays = [] if self.exchanged else [self.ray(arrays().UInt(k)) for k in range(frames.count)]

    def start(self) -> MarchState:
        """The state before the first sample."""
        jit = arrays()
        rays = dr.width(self.direction, self.origin)
        numbers = [dr.zeros(jit.UInt, rays) for _ in range(min(self.frames.slots, self.frames.count))]
        state = MarchState(numbers, dr.zeros(jit.UInt, rays), dr.ones(jit.UInt, rays), [], jit.Float(0), jit.UInt(0))
        if self.exchanged:
            state.entered, state.box = dr.full(jit.Float, -dr.inf, rays), dr.zeros(jit.UInt, rays)
            nothing = self.ray(dr.zeros(jit.UInt, rays))
            nothing.sample_count = dr.zeros(jit.UInt, rays)
            state.rays = [nothing] * self.frames.slots
            for _ in numbers:
                state = self.enter_next_box(state)
        return state

    def unfinished(self, state: MarchState) -> Bool:
        """Whether any slot has a sample left."""
        rays = self._rays(state)
        left = state.numbers[0] < rays[0].sample_count
        for number, ray in zip(state.numbers[1:], rays[1:], strict=True):
            left |= number < ray.sample_count
        return left

    def nearest(self, state: MarchState) -> tuple[UInt, Float, Float, Ray]:
        """The sample next in depth: its slot, distance [m], length of its step [m], and ray."""
        rays = self._rays(state)
        slot, ray = arrays().UInt(0), rays[0]
        distance, length = self._sample(ray, state.numbers[0])
        for k in range(1, len(rays)):
            other, other_length = self._sample(rays[k], state.numbers[k])
            first = other < distance
            slot = dr.select(first, k, slot)
            distance, length = dr.select(first, other, distance), dr.select(first, other_length, length)
            ray = _select(first, rays[k], ray)
        return slot, distance, length, ray

    def skip_empty(self, step: Step, state: MarchState) -> MarchState:
        """Skip to the first sample behind the empty bricks (or blocks of them) around this one."""
        jit = arrays()
        number, ray = self._in_slot(step.slot, state)
        reach, size = ((-step.brick) >> 1) - 1, dr.select((step.brick & 1) == 1, 6, jit.Int(3))
        cell = jit.Array3i(step.place) >> size
        face = dr.select(ray.direction > 0.0, cell + 1 + reach, cell - reach) << size
        distance = dr.min((jit.Array3f(face) - ray.origin) / ray.direction)
        samples = dr.ceil((distance - ray.near) / ray.step + (self.phase - 0.5))
        number = dr.maximum(number + 1, jit.UInt(dr.fmax(samples, 0.0)))
        return self._moved(step, number, state, jit.UInt(0), jit.UInt(1))

    def next_sample(self, step: Step, state: MarchState) -> MarchState:
        """Go to the next whole sample."""
        number, _ = self._in_slot(step.slot, state)
        return self._moved(step, number + 1, state, arrays().UInt(0), arrays().UInt(1))

    def advance(self, step: Step, depth: Float, clearance: Float, state: MarchState) -> MarchState:
        """Advance past a sample of optical depth `depth`: to its first or next sub-sample, or to the next sample.

        clearance: distance around it without matter [m]; None where unknown.
        """
        UInt = arrays().UInt
        number, ray = self._in_slot(step.slot, state)
        whole = dr.ceil(depth * arrays().Float(state.parts) / self.frames.fine)
        parts = dr.maximum(UInt(dr.fmin(whole, MOST_SUB_SAMPLES)), 1)
        again, last = self.must_split(state, depth), state.part + 1 >= state.parts
        part = dr.select(again | last, UInt(0), state.part + 1)
        following = number + 1
        if clearance is not None:
            following = number + dr.maximum(UInt(CLEARANCE_SHARE * clearance / ray.step), 1)
        number = dr.select(last & ~again, following, number)
        return self._moved(step, number, state, part, dr.select(again | last, parts, state.parts))

    def must_split(self, state: MarchState, depth: Float) -> Bool:
        """Whether the sample is too dense for one step: its optical depth `depth` calls for (more) sub-samples."""
        return (depth > SPLIT_FACTOR * self.frames.fine) & (state.part == 0) & (state.parts < MOST_SUB_SAMPLES)

    def enter_next_box(self, state: MarchState) -> MarchState:
        """Give the slot of a box that the ray has left to the box that it enters next, if there is one."""
        if not self.exchanged:
            return state
        slot, free = arrays().UInt(0), state.numbers[0] >= state.rays[0].sample_count
        for k in range(1, len(state.rays)):
            also = ~free & (state.numbers[k] >= state.rays[k].sample_count)
            slot, free = dr.select(also, k, slot), free | also

        def entered(state: MarchState, slot: UInt) -> MarchState:
            box, when = next_box(self, state.entered, state.box)
            exists = box < self.frames.boxes
            ray = self.ray(dr.select(exists, box, 0))
            ray.sample_count = dr.select(exists, ray.sample_count, 0)
            here = [slot == k for k in range(len(state.rays))]
            numbers = [dr.select(h, 0, number) for h, number in zip(here, state.numbers, strict=True)]
            rays = [_select(h, ray, old) for h, old in zip(here, state.rays, strict=True)]
            return MarchState(numbers, state.part, state.parts, rays, when, box)

        open_ = free & (state.box < self.frames.boxes)
        return dr.if_stmt((state, slot), open_, entered, lambda state, slot: state)

    def ray(self, box: UInt) -> Ray:
        """The ray on the lattice of box number `box` (UInt); without samples where it misses the box."""
        jit, frame = arrays(), self.frames.frame(box)
        start, along, enter, leave = self.span(frame)
        level, step = arrays().UInt(0), frame.step
        if textures := self.frames.textures:
            width, spread = self.cone
            row, finest = textures.level(box, dr.fma(spread, dr.fmax(enter, 0.0), width), self.phase)
            textured = textures.textured(box)
            level, step = dr.select(textured, row, level), dr.select(textured, finest, step)
        step = step * self.stride
        samples = dr.ceil((leave - enter) / step + (self.phase - LATTICE_MARGIN))
        hit = (leave > enter) & dr.isfinite(leave)  # false, too, for a ray that is not finite
        end = jit.UInt(dr.select(hit, dr.fmax(samples, 0.0), 0.0))
        return Ray(
            box, start, along, enter, leave, end,
            step, frame.last, frame.tau, frame.row, frame.layer, frame.first, level,
        )  # fmt: skip

    def span(self, frame: Frame) -> tuple[Array3f, Array3f, Float, Float]:
        """Origin and direction on a lattice, and the distances [m] where the ray enters and leaves it."""
        jit, (x, y, z) = arrays(), frame.columns
        start = self.origin.x * x + self.origin.y * y + self.origin.z * z + frame.shift
        along = self.direction.x * x + self.direction.y * y + self.direction.z * z
        along = dr.select(dr.abs(along) < 1e-9, 1e-9, along)  # a ray within a lattice plane: no 0/0 below
        faces = (-0.5 - start) / along, (frame.last + 0.5 - start) / along
        enter = dr.fmax(dr.max(jit.Array3f(*map(dr.fmin, *faces))), self.near)
        leave = dr.fmin(dr.min(jit.Array3f(*map(dr.fmax, *faces))), self.far)
        return start, along, enter, leave

    def _rays(self, state: MarchState) -> list[Ray]:
        """The rays in the slots."""
        return state.rays if self.exchanged else self.rays

    def _in_slot(self, slot: UInt, state: MarchState) -> tuple[UInt, Ray]:
        """Number of the next sample, and ray, of a slot."""
        rays = self._rays(state)
        number, ray = state.numbers[0], rays[0]
        for k in range(1, len(rays)):
            number, ray = dr.select(slot == k, state.numbers[k], number), _select(slot == k, rays[k], ray)
        return number, ray

    def _moved(self, step: Step, number: UInt, state: MarchState, part: UInt, parts: UInt) -> MarchState:
        """The state with sample `number` next in the slot of `step`."""
        numbers = [number]
        if len(state.numbers) > 1:
            numbers = [dr.select(step.slot == k, number, old) for k, old in enumerate(state.numbers)]
        return MarchState(numbers, part, parts, state.rays, state.entered, state.box)

    def _sample(self, ray: Ray, number: UInt) -> tuple[Float, Float]:
        """Middle and length of a sample; behind all others once the box is done. The first and last may be shorter."""
        before = arrays().Float(number) - self.phase
        begin = dr.fma(dr.fmax(before, 0.0), ray.step, ray.near)
        length = dr.fmin(dr.fma(before + 1.0, ray.step, ray.near), ray.far) - begin
        middle = dr.fma(length, 0.5, begin)
        return (middle if self.frames.slots == 1 else dr.select(number < ray.sample_count, middle, math.inf)), length


@dr.syntax
def next_box(crossing: Crossing, entered: Float, last: UInt) -> tuple[UInt, Float]:
    """Number of the box that rays enter next after box `last`, which they `entered` [m]; the count of boxes if none."""
    jit = arrays()
    k, box, when = jit.UInt(0), jit.UInt(crossing.frames.boxes), jit.Float(dr.inf)
    while k < crossing.frames.boxes:
        _, _, enter, leave = crossing.span(crossing.frames.frame(k))
        later = (enter > entered) | ((enter == entered) & (k > last))
        nearer = later & (leave > enter) & dr.isfinite(leave) & (enter < when)
        box, when = dr.select(nearer, k, box), dr.select(nearer, enter, when)
        k += 1
    return box, when


def _select(mask: Bool, yes: Any, no: Any) -> Any:
    """`dr.select` through the fields of a record."""
    return type(yes)(*(dr.select(mask, getattr(yes, f.name), getattr(no, f.name)) for f in fields(yes)))
