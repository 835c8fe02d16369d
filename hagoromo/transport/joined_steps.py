"""Joined steps: small steps of a ray one after the other, which are lit at one sample, in the heaviest of them.

A ray crosses the corners of many cells, and thin matter before it comes to dense: a sample for each would cost as much
as one that the picture shows.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import drjit as dr

from hagoromo.backend import Bool, Float, Int, arrays, clip
from hagoromo.transport.crossing import depth_share, share_at_depth
from hagoromo.transport.intervals import Interval
from hagoromo.transport.step_elements import centroid, mean_of_decay

LEAST_SHARE = 1e-3  # of the optical depth of steps, in front of their sample and behind it


@dataclass
class JoinedSteps:
    """Steps of a ray in one box, and the heaviest of them. waiting: for a further step, and to be lit with it."""

    waiting: Bool
    since: Float  # where they begin, from the entry of the ray [m]
    front: Float  # optical depth of all boxes in front of them
    own: Float  # of their own box in them
    begin: Float  # of the heaviest one: from the entry of the ray [m]
    end: Float
    depth: Float  # its optical depth in all boxes
    before: Float  # and in front of it
    growth: Float
    brick: Int
    weight: Float | None = None  # share of a pixel's light that comes from it; None where steps are not joined
    weights: Float | None = None  # from all of them
    moment: Float | None = None  # of these, along the ray [m]

    def place(self, total: Float) -> tuple[Float, Float, Float]:
        """The place of their sample: the middle of all of them by their weights, or the next one in the heaviest.

        It is a share of the optical depth of the heaviest, one of that of all of them, which is `total`, and a distance
        from the entry of the ray [m].
        """
        length = self.end - self.begin
        if self.moment is None:
            share = centroid(self.depth)
            return share, share, dr.fma(share_at_depth(share, self.growth), length, self.begin)
        part = clip((self.moment / self.weights - self.begin) / length, 0.0, 1.0)
        share = depth_share(part, self.growth)
        whole = (dr.fma(share, self.depth, self.before) - self.front) / total
        return share, clip(whole, LEAST_SHARE, 1.0 - LEAST_SHARE), dr.fma(part, length, self.begin)


def none_joined(count: int) -> JoinedSteps:
    """No steps that wait."""
    jit = arrays()
    nothing, brick = dr.zeros(jit.Float, count), dr.zeros(jit.Int, count)
    since = front = own = begin = end = depth = before = growth = nothing
    steps = JoinedSteps(dr.zeros(jit.Bool, count), since, front, own, begin, end, depth, before, growth, brick)
    return replace(steps, weight=nothing, weights=nothing, moment=nothing)


def joined_with(joined: JoinedSteps | None, interval: Interval, begin: Float, end: Float, depth: Float) -> JoinedSteps:
    """The steps that wait, None where steps are not joined, and an interval from `begin` to `end`; depth: of all boxes
    in front of its end.
    """
    total = dr.fmax(depth - interval.before, interval.depth)
    if joined is None:
        front, own = interval.before, interval.depth
        return JoinedSteps(
            arrays().Bool(False), begin, front, own, begin, end, total, front, interval.growth, interval.brick
        )
    first = ~joined.waiting
    since, front = dr.select(first, begin, joined.since), dr.select(first, interval.before, joined.front)
    middle = dr.fma(share_at_depth(centroid(total), interval.growth), end - begin, begin)
    weight = dr.exp(-interval.before) * interval.depth * mean_of_decay(total)
    heavier = first | (weight > joined.weight)
    begin, end, most, before, growth, brick, heaviest = (
        dr.select(heavier, one, other)
        for one, other in (
            (begin, joined.begin), (end, joined.end), (total, joined.depth), (interval.before, joined.before),
            (interval.growth, joined.growth), (interval.brick, joined.brick), (weight, joined.weight),
        )
    )  # fmt: skip
    own = dr.select(first, interval.depth, joined.own + interval.depth)
    weights, moment = (dr.select(first, 0.0, sum_so_far) for sum_so_far in (joined.weights, joined.moment))
    return JoinedSteps(
        joined.waiting, since, front, own, begin, end, most, before, growth, brick,
        heaviest, weights + weight, dr.fma(weight, middle, moment),
    )  # fmt: skip
