"""Crossing: rays through volume boxes, cell by cell, in the order of depth.

Enters: rays in the world. Leaves: the next interval of each, which lies within one cell between eight voxel centres, or
within empty bricks. A ray has a slot for each box that it may be in at once; a box that it has left gives its slot to
the next. With a slot for every box, rays are set up once, before the march.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

import drjit as dr

from hagoromo.backend import Array3f, Bool, Float, Int, UInt, arrays, clip
from hagoromo.transport.frames import DENSEST, BoxFrame, Frames

LATTICE_MARGIN = 1e-3  # [voxel] from the last voxel centre that samples keep, so that interpolation stays inside
NUDGE = 1e-3  # [voxel] ahead of the begin of an interval where its cell is looked up; no interval of a cell is shorter
LAST_IN_CELL = 0.9999  # [voxel] from the first voxel centre of a cell to the last place in it
CELL_BITS, BRICK_BITS = 0, 3  # a cell is 2^0 voxels wide, a brick 2^3
Cone = tuple[Float, Float]  # footprint of a ray: its width at the origin [m], and the growth of that per metre [1]


@dataclass
class Ray:
    """A ray on the lattice of one box, with what its samples need of the box. Distances are from its entry."""

    box: UInt
    origin: Array3f  # lattice coordinates of the entry [voxel]
    direction: Array3f  # [voxel/m]
    near: Float  # distance of the entry from the origin of the ray [m]
    far: Float  # distance at which it leaves; 0 where it misses the box [m]
    probe: Float  # from the begin of an interval to where its cell is looked up [m]
    last: Array3f  # voxels along x, y, z, less 1
    tau: Float  # extinction per unit of density [1/m]
    densest: Float  # largest extinction, see `Frames` [1/m]
    longest: Float  # longest step [m]
    row: Int  # blocks along x in the brick table
    layer: Int  # blocks along x times blocks along y
    first: Int  # entry of the coarse table where the box starts
    level: UInt  # row of the level of its texel, see `Textures`

    def at(self, distance: Float) -> Array3f:
        """Lattice coordinates [voxel] at a distance from the entry [m]."""
        return dr.fma(self.direction, distance, self.origin)

    def inside(self, place: Array3f) -> Array3f:
        """Lattice coordinates brought between the first and the last voxel centres, to [0, n − 1)."""
        return type(place)(*(clip(place[k], 0.0, self.last[k] - LATTICE_MARGIN) for k in range(3)))


@dataclass
class MarchState:
    """The open interval of each slot: where it begins and ends, from the entry of its ray [m].

    With more boxes than slots also the ray in each slot, and the box that was entered last.
    """

    begins: list[Float]
    ends: list[Float]
    rays: list[Ray]  # one per slot; empty where there is a slot for every box
    entered: Float | None  # distance at which the ray entered `box` [m]; None where there is a slot for every box
    box: UInt | None  # number of the box entered last


@dataclass
class MarchInterval:
    """The next interval of a slot, and the extinction along it: σ(x) = (depth / length) (1 + growth (2x − 1)), where x
    runs from 0 to 1.
    """

    slot: UInt
    ray: Ray
    begin: Float  # from the entry of the ray [m]
    end: Float
    place: Array3f  # lattice coordinates by which its cell was found, inside [0, n − 1)
    brick: Int  # ≥ 0: number of the stored brick; < 0: distance to the next one, see `BrickTable`
    depth: Float  # optical depth
    growth: Float  # −1 … 1


class Crossing:
    """Rays on the lattices of all boxes."""

    def __init__(self, frames: Frames, rays: tuple[Array3f, Array3f, Float, Float], phase: Float, cone: Cone) -> None:
        """`rays`: origin, direction (Array3f), near and far [m]; `phase`, `cone`: see `Medium.cross`."""
        self.frames, self.phase, self.cone, self.branches = frames, phase, cone, True
        self.origin, self.direction, self.near, self.far = rays
        self.exchanged = frames.count > frames.slots
        self.rays = [] if self.exchanged else [self.ray(arrays().UInt(k)) for k in range(frames.count)]

    def start(self) -> MarchState:
        """The state before the first interval."""
        jit = arrays()
        count = dr.width(self.direction, self.origin)
        slots = min(self.frames.slots, self.frames.count)
        begins, ends = ([dr.zeros(jit.Float, count) for _ in range(slots)] for _ in range(2))
        state = MarchState(begins, ends, [], None, None)
        if self.exchanged:
            state.entered, state.box = dr.full(jit.Float, -dr.inf, count), dr.zeros(jit.UInt, count)
            nothing = self.ray(dr.zeros(jit.UInt, count))
            nothing.far = dr.zeros(jit.Float, count)
            state.rays = [nothing] * slots
            for _ in begins:
                state = self.enter_next_box(state)
        return state

    def unfinished(self, state: MarchState) -> Bool:
        """Whether any slot has an interval left."""
        rays = self.slot_rays(state)
        left = state.begins[0] < rays[0].far
        for begin, ray in zip(state.begins[1:], rays[1:], strict=True):
            left |= begin < ray.far
        return left

    def nearest(self, state: MarchState) -> tuple[UInt, Float, Ray]:
        """The slot whose open interval ends first: its number, where that is from its entry [m], and its ray."""
        rays = self.slot_rays(state)
        slot, ray, distance = arrays().UInt(0), rays[0], state.ends[0]
        if len(rays) > 1:
            nearest = self._world_end(state, 0)
            for k in range(1, len(rays)):
                other = self._world_end(state, k)
                first = other < nearest
                nearest, slot = dr.select(first, other, nearest), dr.select(first, k, slot)
                distance, ray = dr.select(first, state.ends[k], distance), selected(first, rays[k], ray)
        return slot, distance, ray

    def interval_end(self, ray: Ray, begin: Float, place: Array3f, brick: Int, stored: int | Int = CELL_BITS) -> Float:
        """Where the cell, or the empty bricks (or blocks of them), that a ray is in at `begin` end, from its entry [m].

        place: lattice coordinates a `probe` behind `begin`. stored: CELL_BITS, or bits of the voxels along a part of a
        stored brick, BRICK_BITS for all of it, whose end is wanted in place of that of its cell.
        """
        jit = arrays()
        empty, ahead = brick < 0, ray.direction > 0.0
        place = dr.select(empty & ahead, dr.fmax(place, 0.0), place)  # half a voxel before the first is in its brick
        reach = dr.select(empty, ((-brick) >> 1) - 1, 0)
        size = dr.select(empty, dr.select((brick & 1) == 1, 6, jit.Int(BRICK_BITS)), stored)
        cell = jit.Array3i(dr.floor(place)) >> size
        face = dr.select(ahead, cell + 1 + reach, cell - reach) << size
        end, least = dr.min((jit.Array3f(face) - ray.origin) / ray.direction), begin + 2.0 * self.probe(ray, begin)
        textures = self.frames.textures if isinstance(stored, int) and stored == CELL_BITS else None
        if textures is not None:  # steps of a texel lie on one grid along the ray: what it cuts is random
            step = 2.0 * ray.probe
            behind = (dr.ceil(end / step + (self.phase - 0.5)) - self.phase) * step
            end = dr.select(textures.textured(ray.box), dr.select(empty, behind, least), end)
        return dr.fmin(dr.fmax(end, least), ray.far)

    def probe(self, ray: Ray, begin: Float) -> Float:
        """From the begin of an interval to where its cell is looked up [m]: half a step in a texel, else a nudge."""
        if self.frames.textures is None:
            return ray.probe
        return ray.probe * dr.select(begin == 0.0, 1.0 - self.phase, 1.0)

    def advance(self, step: MarchInterval, state: MarchState) -> MarchState:
        """Go behind an interval."""
        return self.open(step, state, step.end)

    def open(self, step: MarchInterval, state: MarchState, begin: Float) -> MarchState:
        """Make the interval from `begin` to the end of `step` the open one of its slot."""
        if len(state.ends) == 1:
            begins, ends = [begin], [step.end]
        else:
            here = [step.slot == k for k in range(len(state.ends))]
            begins = [dr.select(h, begin, old) for h, old in zip(here, state.begins, strict=True)]
            ends = [dr.select(h, step.end, old) for h, old in zip(here, state.ends, strict=True)]
        return MarchState(begins, ends, state.rays, state.entered, state.box)

    def enter_next_box(self, state: MarchState) -> MarchState:
        """Give the slot of a box that the ray has left to the box that it enters next, if there is one."""
        if not self.exchanged:
            return state
        slot, free = arrays().UInt(0), state.begins[0] >= state.rays[0].far
        for k in range(1, len(state.rays)):
            also = ~free & (state.begins[k] >= state.rays[k].far)
            slot, free = dr.select(also, k, slot), free | also

        def entered(state: MarchState, slot: UInt) -> MarchState:
            box, when = next_box(self if self.branches else self.fixed(), dr.detach(state.entered), state.box)
            exists = box < self.frames.boxes
            ray = self.ray(dr.select(exists, box, 0))
            ray.far = dr.select(exists, ray.far, 0.0)
            here = [slot == k for k in range(len(state.rays))]
            begins, ends = (
                [dr.select(h, 0.0, old) for h, old in zip(here, places, strict=True)]
                for places in (state.begins, state.ends)
            )
            rays = [selected(h, ray, old) for h, old in zip(here, state.rays, strict=True)]
            return MarchState(begins, ends, rays, when, box)

        open_ = free & (state.box < self.frames.boxes)
        if not self.branches:  # see `DifferentiableMedium`
            return selected(open_, entered(state, slot), state)
        return dr.if_stmt((state, slot), open_, entered, lambda state, slot: state)

    def fixed(self) -> Crossing:
        """The same rays without derivatives."""
        rays = dr.detach(self.origin), dr.detach(self.direction), dr.detach(self.near), dr.detach(self.far)
        return Crossing(self.frames, rays, self.phase, self.cone)

    def ray(self, box: UInt) -> Ray:
        """The ray on the lattice of box number `box` (UInt); without length where it misses the box."""
        frame = self.frames.frame(box)
        start, along, enter, leave = self.span(frame)
        voxel = dr.rsqrt(dr.squared_norm(along))
        level, probe = arrays().UInt(0), NUDGE * voxel
        if textures := self.frames.textures:
            width, spread = self.cone
            row, finest = textures.level(box, dr.fma(spread, dr.fmax(enter, 0.0), width), self.phase)
            textured = textures.textured(box)
            level, probe = dr.select(textured, row, level), dr.select(textured, 0.5 * finest, probe)
        hit = (leave > enter) & dr.isfinite(leave)  # false, too, for a ray that is not finite
        enter, length = dr.select(hit, enter, 0.0), dr.select(hit, leave - enter, 0.0)
        return Ray(
            box, dr.fma(along, enter, start), along, enter, length,
            probe, frame.last, frame.tau, DENSEST / voxel, frame.step, frame.row, frame.layer, frame.first, level,
        )  # fmt: skip

    def span(self, frame: BoxFrame) -> tuple[Array3f, Array3f, Float, Float]:
        """Origin and direction on a lattice, and the distances [m] where the ray enters and leaves its matter."""
        jit, (x, y, z) = arrays(), frame.columns
        start = self.origin.x * x + self.origin.y * y + self.origin.z * z + frame.shift
        along = self.direction.x * x + self.direction.y * y + self.direction.z * z
        along = dr.select(dr.abs(along) < 1e-9, 1e-9, along)  # a ray within a lattice plane: no 0/0 below
        faces = [(bound - start) / along for bound in frame.bounds]
        enter = dr.fmax(dr.max(jit.Array3f(*map(dr.fmin, *faces))), self.near)
        leave = dr.fmin(dr.min(jit.Array3f(*map(dr.fmax, *faces))), self.far)
        return start, along, enter, leave

    def slot_rays(self, state: MarchState) -> list[Ray]:
        """The rays in the slots."""
        return state.rays if self.exchanged else self.rays

    def _world_end(self, state: MarchState, slot: int) -> Float:
        """Distance from the origin of the ray at which the open interval of a slot ends [m]; none left: infinity."""
        ray = self.slot_rays(state)[slot]
        return dr.select(state.begins[slot] < ray.far, ray.near + state.ends[slot], math.inf)


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


def selected(mask: Bool, yes: Any, no: Any) -> Any:
    """`dr.select` through the fields of a record."""
    if isinstance(yes, list):
        return [selected(mask, y, n) for y, n in zip(yes, no, strict=True)]
    if not is_dataclass(yes):
        return dr.select(mask, yes, no)
    return type(yes)(*(selected(mask, getattr(yes, f.name), getattr(no, f.name)) for f in fields(yes)))


def depth_share(share: Float, growth: Float) -> Float:
    """Share of the optical depth of a step in front of a `share` 0…1 of its length, see `MarchInterval`."""
    return dr.fma(growth * share, share - 1.0, share)


def share_at_depth(share: Float, growth: Float) -> Float:
    """The inverse of `depth_share`: share of the length by which a `share` of the optical depth is reached."""
    at_begin = 1.0 - growth
    root = dr.sqrt(dr.fmax(dr.fma(4.0 * growth, share, at_begin * at_begin), 0.0))
    return dr.fmin(2.0 * share / dr.fmax(at_begin + root, 1e-9), 1.0)
