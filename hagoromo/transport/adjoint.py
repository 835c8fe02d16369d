"""Adjoint: the derivative of light along rays by all that it depends on, in reverse mode, for a few marches.

A replay takes the steps of a forward march once more and differentiates one sample at a time, with the light behind it
known (path replay: Vicini, Speierer & Jakob 2021). Dr.Jit differentiates the sample: no law is written twice. A step
lies within one cell of every box and has two samples, the Gauss points by which its optical depth is integrated. With
their extinction σ, the length l of the step, and the optical depth D in front of a sample and d of the step,

    light = Σ ½ l σ exp(−D) I,        transmittance = exp(−Σ d),

so that a change of d scales the light of all steps behind. Samples have fixed places in their steps, and know nothing
of each other: `march`, which fits the light of a step to the samples before and behind, has no such derivative.
"""

from __future__ import annotations

import functools
import math
import operator
from collections.abc import Sequence
from dataclasses import dataclass, replace

import drjit as dr

from hagoromo.backend import Bool, Float, arrays
from hagoromo.transport.crossing import Crossing, MarchInterval, Ray, depth_share
from hagoromo.transport.differentiable_medium import DifferentiableMedium
from hagoromo.transport.lighting import Lighting
from hagoromo.transport.march import OPAQUE_OPTICAL_DEPTH, radiance_from_sample
from hagoromo.transport.medium import GAUSS_NODE, Limit
from hagoromo.transport.moving import Moving, Rays, on_ray
from hagoromo.transport.shadows_back import LEAST_SHARE, ShadowsBack

LONGER = 2.0  # steps than those of `march`, which have one sample


@dataclass
class Sample:
    """A sample of a step. parts: of the step in each box; the brick is −1 where the ray is not in the box."""

    parts: list[MarchInterval]
    before: Float  # optical depth in front of the step
    matter: Bool  # whether the step has any; without, it has one sample, in its middle
    second: Bool  # of the two

    @property
    def side(self) -> Float:
        """Its place from the middle of the step, in halves of it."""
        return dr.select(self.matter, dr.select(self.second, GAUSS_NODE, arrays().Float(-GAUSS_NODE)), 0.0)

    @property
    def last(self) -> Bool:
        """Whether it is the last of its step."""
        return self.second | ~self.matter

    @property
    def total(self) -> Float:
        """Optical depth of the step."""
        return sum((part.depth for part in self.parts[1:]), self.parts[0].depth)


class MarchAdjoint:
    """The march of a scene and its replay. A plain object: loops do not take its arrays into their state."""

    def __init__(
        self, medium: DifferentiableMedium, lighting: Lighting, shadows: ShadowsBack, by_density: bool, moving: Moving
    ) -> None:
        """shadows: by which `lighting` shades. by_density: whether cells without matter have a derivative, too."""
        self.medium, self.search, self.lighting, self.shadows = medium, medium.searching(), lighting, shadows
        self.by_density, self.moving = by_density, moving
        self.by_channels: list[Float] = []

    def forward(self, rays: Rays) -> tuple[list[Float], Float]:
        """Weights of the radiance, and the transmittance."""
        with dr.suspend_grad():
            channels, depth, _ = _walk(self, rays, None)
            return channels, dr.select(depth >= OPAQUE_OPTICAL_DEPTH, 0.0, dr.exp(-depth))

    def backward(self, rays: Rays, by_channels: Sequence[Float], behind: Float) -> list[Float]:
        """Add the derivative of a loss to the gradients of all that is tracked; that by what moves, for every ray.

        by_channels: that by each channel, for every ray. behind: Σ by_channels · channels of the forward march, and the
        transmittance times the derivative by it.
        """
        self.by_channels = list(by_channels)
        with dr.suspend_grad():
            channels, depth, by_moved = _walk(self, rays, behind)
            dr.eval(channels, depth, by_moved)
            return by_moved

    def sample(
        self, crossing: Crossing, lattices: list[Ray], begins: list[Float], before: Float, second: Bool
    ) -> tuple[Sample, Float]:
        """The next sample, and the length of its step [m]."""
        inside = [(begin >= 0.0) & (begin < ray.far) for begin, ray in zip(begins, lattices, strict=True)]
        limit = _limit(crossing, inside, self.medium.empty)
        parts, length = [], arrays().Float(dr.inf)
        for k, (ray, begin) in enumerate(zip(lattices, begins, strict=True)):
            part = self.search.interval(crossing, arrays().UInt(k), dr.fmax(begin, 0.0), ray)
            part.brick = dr.select(inside[k], part.brick, -1)
            part = self.search.extinction(part, crossing.direction, limit)
            parts.append(part)
            ahead = dr.select(begin < 0.0, -begin, dr.inf)
            length = dr.fmin(length, dr.select(inside[k], part.end - begin, ahead))
        if len(parts) > 1:
            parts = [replace(part, end=dr.fmin(part.begin + length, part.end)) for part in parts]
            parts = [self.search.extinction(part, crossing.direction) for part in parts]
        matter = functools.reduce(operator.or_, (part.depth > self.medium.empty for part in parts))
        return Sample(parts, before, matter, second), length

    def lit(self, sample: Sample, back: bool) -> Bool:
        """Whether a sample is lit."""
        if not (back and self.by_density):
            return sample.matter
        stored = functools.reduce(operator.or_, (part.brick >= 0 for part in sample.parts))
        return sample.matter | (stored & (sample.before < -math.log(LEAST_SHARE)))

    def light(self, rays: Rays, sample: Sample) -> tuple[list[Float], Float]:
        """What a sample adds to the channels, and the optical depth of its step."""
        medium, lighting, side = self.medium, self.lighting, sample.side
        stored = [replace(part, brick=dr.maximum(part.brick, 0)) for part in sample.parts]
        dense = [medium.extinction(part, rays.direction) for part in stored]
        depths = [dr.select(old.brick >= 0, new.depth, 0.0) for old, new in zip(sample.parts, dense, strict=True)]
        place, share = sample.before, 0.5 + 0.5 * side
        for part, depth in zip(dense, depths, strict=True):
            place = place + depth * depth_share(share, part.growth)
        reach = dr.select(sample.matter, 0.5, arrays().Float(1.0)) * dr.exp(-place)
        channels = [arrays().Float(0)] * lighting.channels
        for part, depth in zip(dense, depths, strict=True):
            gain = reach * depth * dr.fma(part.growth, side, 1.0)
            distance = dr.fma(share, part.end - part.begin, part.begin)
            here = medium.sample(part, distance)
            point = dr.fma(rays.direction, distance + part.ray.near, rays.origin)
            radiance, _, _ = radiance_from_sample(medium, lighting, here, here, point, rays.direction)
            added = lighting.in_groups([gain * each for each in radiance])
            channels = [old + new for old, new in zip(channels, added, strict=True)]
        return channels, sum(depths[1:], depths[0])

    def light_back(self, rays: Rays, sample: Sample, behind: Float) -> tuple[Float, Float, list[Float]]:
        """Differentiate a sample. behind: its light and that of all behind it, in units of the loss. Leaves: what is
        left of that, the optical depth of the step, and the derivative by what moves.
        """
        self.shadows.seen = dr.select(sample.matter, dr.exp(-sample.before), 0.0)
        with dr.resume_grad():
            moved = self.moving.track(rays)
            channels, total = self.light(moved, self._on(moved, sample))
            own = sum(by * channel for by, channel in zip(self.by_channels, channels, strict=True))
            behind = behind - dr.detach(own)
            dr.backward_from(own - total * dr.select(sample.last, behind, 0.0))
            by_moved = self.moving.gradients()
        return behind, dr.detach(total), by_moved

    def _on(self, rays: Rays, sample: Sample) -> Sample:
        """The sample on rays that are tracked: its places from their entries in boxes stay; so do faces of boxes."""
        if not self.moving.rays:
            return sample
        crossing = self.medium.cross(rays.origin, rays.direction, arrays().Float(0), rays.far)
        parts = [on_ray(crossing.ray(part.ray.box), part) for part in sample.parts]
        return replace(sample, parts=parts)

    def taken(
        self, rays: Rays, sample: Sample, channels: list[Float], behind: Float | None, by_moved: list[Float]
    ) -> tuple[list[Float], Float | None, list[Float], Float]:
        """Take a sample: the channels with it; or, in a replay, what is left behind it, and the derivatives by what
        moves with its own; and the optical depth of its step.
        """
        if behind is None:
            added, total = self.light(rays, sample)
            return sums(channels, added), None, by_moved, total
        behind, total, more = self.light_back(rays, sample, behind)
        return channels, behind, sums(by_moved, more), total


@dr.syntax
def _walk(adjoint: MarchAdjoint, rays: Rays, behind: Float | None) -> tuple[list[Float], Float, list[Float]]:
    """Along rays the channels, or their derivative where light `behind` is given; the optical depth; the derivative by
    what moves.
    """
    jit, count = arrays(), dr.width(rays.direction)
    crossing = adjoint.search.cross(rays.origin, rays.direction, jit.Float(0), rays.far)
    lattices = [crossing.ray(jit.UInt(k)) for k in range(crossing.frames.count)]
    channels = [dr.zeros(jit.Float, count) for _ in range(adjoint.lighting.channels)]
    by_moved = [dr.zeros(jit.Float, count) for _ in range(adjoint.moving.count)]
    depth, begins, second = dr.zeros(jit.Float, count), starts(lattices, count), dr.zeros(jit.Bool, count)
    while left(lattices, begins) & (depth < OPAQUE_OPTICAL_DEPTH):
        sample, length = adjoint.sample(crossing, lattices, begins, depth, second)
        total, last = sample.total, sample.last
        if adjoint.lit(sample, behind is not None):
            channels, behind, by_moved, total = adjoint.taken(rays, sample, channels, behind, by_moved)
        depth = dr.select(last, depth + total, depth)
        begins = advanced(sample.parts, begins, length, last)
        second = ~last
    return channels, depth, by_moved


def _limit(crossing: Crossing, inside: list[Bool], empty: Float) -> Limit:
    """Parts of a step in matter, so that it is neither too deep, in all boxes together, nor too long; empty: optical
    depth of a step without.
    """
    boxes = sum(dr.select(here, 1.0, arrays().Float(0)) for here in inside)

    def parts(step: MarchInterval) -> Float:
        deep = step.depth * boxes / crossing.frames.deepest
        needed = dr.ceil(dr.fmax(deep, (step.end - step.begin) / step.ray.longest) / LONGER)
        return dr.select(step.depth > empty, needed, 1.0)

    return parts


def starts(lattices: list[Ray], count: int) -> list[Float]:
    """Where rays begin, from their entry in each box [m]: below 0 in boxes that they enter later."""
    zeros = dr.zeros(arrays().Float, count)
    if len(lattices) == 1:
        return [zeros]
    hit = [ray.far > 0.0 for ray in lattices]
    entries = [dr.select(there, ray.near, dr.inf) for there, ray in zip(hit, lattices, strict=True)]
    first = functools.reduce(dr.fmin, entries)
    return [dr.select(there, first - ray.near, 0.0) + zeros for there, ray in zip(hit, lattices, strict=True)]


def left(lattices: list[Ray], begins: list[Float]) -> Bool:
    """Whether some box is not passed."""
    ahead = [begin < ray.far for ray, begin in zip(lattices, begins, strict=True)]
    return functools.reduce(operator.or_, ahead)


def advanced(parts: list[MarchInterval], begins: list[Float], length: Float, last: Bool) -> list[Float]:
    """Where the next sample's step begins in each box: behind this one, if the sample is its `last`."""
    if len(parts) == 1:
        return [dr.select(last, parts[0].end, begins[0])]
    ends = [dr.select(begin < 0.0, begin + length, part.end) for part, begin in zip(parts, begins, strict=True)]
    return [dr.select(last, end, begin) for end, begin in zip(ends, begins, strict=True)]


def sums(some: list[Float], others: list[Float]) -> list[Float]:
    """Of each pair."""
    return [one + other for one, other in zip(some, others, strict=True)]
