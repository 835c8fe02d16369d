"""Free flight: where light that travels through boxes collides, and how much of it passes.

Collisions are drawn by delta tracking (Woodcock et al. 1965) with the majorant of each brick, or of parts of it: a
tentative one at the rate of the majorant, which is real in the share that the extinction is of it. Boxes that overlap
are flown through one after the other: the nearest of their collisions is that of their sum. Transmittance is that by
ratio tracking (Novák, Selle & Jarosz 2014). Neither has an error but noise; extinction is that of `Medium`, at places
and not along steps.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import drjit as dr

from hagoromo.backend import Array3f, Bool, Float, Int, UInt, arrays, clip
from hagoromo.transport.crossing import BRICK_BITS, LAST_IN_CELL, NUDGE, Crossing, MarchInterval, Ray, selected
from hagoromo.transport.frames import DENSEST
from hagoromo.transport.medium import Medium
from hagoromo.transport.path.majorants import PART_BITS, Majorants
from hagoromo.volume.voxels import BRICK

LEAST_PASSED = 0.1  # transmittance below which a shadow ray goes on by chance
LAST_IN_BRICK = BRICK - 1.0 + LAST_IN_CELL  # [voxel] from the first voxel centre of a brick
Random = Any  # PCG32: one stream of random numbers a ray


@dataclass
class Collision:
    """Where a ray collides first: distance [m] (infinity: nowhere), box, and place in its lattice [voxel]."""

    distance: Float
    box: UInt
    place: Array3f
    brick: Int


class Matter:
    """The boxes of a scene as paths need them."""

    def __init__(self, medium: Medium) -> None:
        self.medium, self.majorants = medium, Majorants(medium.boxes)

    def in_brick(self, crossing: Crossing, ray: Ray, at: Float) -> tuple[Int, Array3f, Float, Float]:
        """Of a ray `at` a distance from its entry: the brick, its first voxel, where the ray leaves it, or the
        part of it, and the majorant.

        Empty bricks together are left at once; their majorant is 0.
        """
        medium, jit = self.medium, arrays()
        place = ray.at(at + ray.probe)
        inside = ray.inside(place)
        brick = medium.brick_at(ray, inside)
        stored = brick >= 0
        majorant, in_part = self.majorants.of(ray, jit.UInt(dr.select(stored, brick, 0)), inside)
        bits = dr.select(in_part, jit.Int(PART_BITS), BRICK_BITS)
        leaves = crossing.interval_end(ray, at, place, brick, bits)
        first = jit.Array3f((jit.Array3i(inside) >> BRICK_BITS) << BRICK_BITS)
        return brick, first, leaves, dr.select(stored, majorant, 0.0)

    def place(self, ray: Ray, at: Float, first: Array3f) -> Array3f:
        """Lattice coordinates of a ray at a distance from its entry, within the brick whose first voxel is `first`."""
        place = ray.inside(ray.at(at))
        return type(place)(*(clip(place[k], first[k], first[k] + LAST_IN_BRICK) for k in range(3)))

    def extinction(
        self, ray: Ray, place: Array3f, brick: Int, direction: Array3f, least: Float = 0.0
    ) -> tuple[Float, Float]:
        """σ at a place in a stored brick, for light along the unit `direction` (world) [1/m]; and how far from there it
        meets no matter [m]. least: see `Medium.extinction_at`.
        """
        nothing = arrays().Float(0)
        step = MarchInterval(arrays().UInt(0), ray, nothing, nothing, place, brick, nothing, nothing)
        return self.medium.extinction_at(step, direction, least)

    def ray(self, crossing: Crossing, box: UInt) -> Ray:
        """The ray on the lattice of a box; in a texel, too, bricks are looked up a nudge ahead."""
        ray = crossing.ray(box)
        return replace(ray, probe=NUDGE * DENSEST / ray.densest)


@dr.syntax
def first_collision(
    matter: Matter, origin: Array3f, direction: Array3f, far: Float, random: Random
) -> tuple[Collision, Random]:
    """The first collision along rays nearer than `far` [m]."""
    jit, count = arrays(), dr.width(direction)
    crossing = matter.medium.cross(origin, direction, jit.Float(0), far)
    nowhere = dr.zeros(jit.Array3f, count), dr.zeros(jit.Int, count)
    found = Collision(dr.full(jit.Float, dr.inf, count), dr.zeros(jit.UInt, count), *nowhere)
    if dr.hint(matter.medium.frames.count == 1, mode="scalar"):
        found, random = collision_in_box(matter, crossing, matter.ray(crossing, jit.UInt(0)), direction, found, random)
    else:
        box = dr.zeros(jit.UInt, count)
        while box < matter.medium.frames.boxes:
            found, random = collision_in_box(matter, crossing, matter.ray(crossing, box), direction, found, random)
            box += 1
    return found, random


@dr.syntax
def collision_in_box(
    matter: Matter, crossing: Crossing, ray: Ray, direction: Array3f, found: Collision, random: Random
) -> tuple[Collision, Random]:
    """The collision in one box if it is nearer than the one that was `found`, else that."""
    jit = arrays()
    at, end = dr.zeros(jit.Float, dr.width(direction)), dr.fmin(ray.far, found.distance - ray.near)
    while at < end:
        brick, first, leaves, majorant = matter.in_brick(crossing, ray, at)
        stop = at - dr.log(1.0 - random.next_float32()) / majorant
        chance = random.next_float32() * majorant
        leaves = dr.fmin(leaves, end)
        tentative = stop < leaves
        at = dr.select(tentative, stop, leaves)
        if tentative:
            place = matter.place(ray, at, first)
            sigma, free = matter.extinction(ray, place, brick, direction, chance)
            found = selected(chance < sigma, Collision(ray.near + at, ray.box, place, brick), found)
            at = dr.select(chance < sigma, end, at + free)
    return found, random


@dr.syntax
def transmittance(
    matter: Matter, origin: Array3f, direction: Array3f, far: Float, lit: Bool, random: Random
) -> tuple[Float, Random]:
    """An estimate of the transmittance of all boxes as far as `far` [m]: its mean is exp(−∫σ). 0 where not `lit`."""
    jit = arrays()
    crossing = matter.medium.cross(origin, direction, jit.Float(0), far)
    passed = dr.select(lit, jit.Float(1), 0.0)
    if dr.hint(matter.medium.frames.count == 1, mode="scalar"):
        passed, random = passed_box(matter, crossing, matter.ray(crossing, jit.UInt(0)), direction, passed, random)
    else:
        box = dr.zeros(jit.UInt, dr.width(direction))
        while (box < matter.medium.frames.boxes) & (passed > 0.0):
            passed, random = passed_box(matter, crossing, matter.ray(crossing, box), direction, passed, random)
            box += 1
    return passed, random


@dr.syntax
def passed_box(
    matter: Matter, crossing: Crossing, ray: Ray, direction: Array3f, passed: Float, random: Random
) -> tuple[Float, Random]:
    """`passed` times an estimate of the transmittance of one box."""
    at = dr.zeros(arrays().Float, dr.width(direction))
    while (at < ray.far) & (passed > 0.0):
        brick, first, leaves, majorant = matter.in_brick(crossing, ray, at)
        stop = at - dr.log(1.0 - random.next_float32()) / majorant
        chance = random.next_float32() * LEAST_PASSED
        leaves = dr.fmin(leaves, ray.far)
        tentative = stop < leaves
        at = dr.select(tentative, stop, leaves)
        if tentative:
            sigma, free = matter.extinction(ray, matter.place(ray, at, first), brick, direction)
            at += free
            passed *= dr.fmax(1.0 - sigma / majorant, 0.0)
            if passed < LEAST_PASSED:  # what is left goes on by chance, as much as before in the mean
                passed = dr.select(chance < passed, LEAST_PASSED, 0.0)
    return passed, random
