"""Intervals: the open interval of every slot of a ray, by which the optical depth of all boxes together is exact.

An interval is closed where it ends before all others, so that those of the other boxes are known beyond its end: the
light of boxes that overlap is attenuated by all of them alike.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr

from hagoromo.backend import Float, Int, UInt, arrays, clip
from hagoromo.transport.crossing import Crossing, MarchInterval, MarchState, depth_share, selected


@dataclass
class Interval:
    """The open interval of a slot: its extinction as in `MarchInterval`, and the optical depth in front of it."""

    depth: Float
    growth: Float
    brick: Int
    box_before: Float  # of the slot's own boxes
    before: Float  # of all boxes


def nothing_open(count: int) -> Interval:
    """The interval before the first."""
    jit = arrays()
    return Interval(*(dr.zeros(kind, count) for kind in (jit.Float, jit.Float, jit.Int, jit.Float, jit.Float)))


def opened(step: MarchInterval, last: Interval, depth: Float) -> Interval:
    """The interval of a step, behind the `last` one of its slot; depth: optical depth of all boxes in front of it."""
    return Interval(step.depth, step.growth, step.brick, last.box_before + last.depth, depth)


def depth_at(crossing: Crossing, state: MarchState, intervals: list[Interval], step: MarchInterval) -> Float:
    """Optical depth of all boxes in front of the begin of a step: that of each, with its part of the open interval."""
    if len(intervals) == 1:
        return intervals[0].before + intervals[0].depth
    place, depth = step.ray.near + step.begin, arrays().Float(0)
    for k, (interval, ray) in enumerate(zip(intervals, crossing.slot_rays(state), strict=True)):
        begin, end = state.begins[k], state.ends[k]
        share = clip((place - ray.near - begin) / dr.fmax(end - begin, 1e-12), 0.0, 1.0)
        depth += interval.box_before + interval.depth * depth_share(share, interval.growth)
    return depth


def boxes_at(crossing: Crossing, state: MarchState, step: MarchInterval) -> Float:
    """Number of boxes that a ray is in where a step begins."""
    rays, one = crossing.slot_rays(state), arrays().Float(1)
    if len(rays) == 1:
        return one
    place = step.ray.near + step.begin
    return sum(dr.select((ray.near <= place) & (place < ray.near + ray.far), one, 0.0) for ray in rays)


def in_slot(each: list[Any], slot: UInt) -> Any:
    """The entry of a slot."""
    chosen = each[0]
    for k in range(1, len(each)):
        chosen = selected(slot == k, each[k], chosen)
    return chosen


def put(each: list[Any], slot: UInt, value: Any) -> list[Any]:
    """The entries with that of a slot replaced."""
    if len(each) == 1:
        return [value]
    return [selected(slot == k, value, old) for k, old in enumerate(each)]
