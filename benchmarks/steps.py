"""Steps: how many samples a frame's camera rays take, and how many of them stand in kept bricks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import drjit as dr

import hagoromo as hg
from hagoromo.backend import arrays
from hagoromo.transport.film import tile_place
from hagoromo.transport.march import END_TRANSMITTANCE
from hagoromo.transport.medium import Medium


def steps_of(boxes: Sequence[hg.VolumeBox], camera: hg.Camera) -> dict[str, int]:
    """Steps of all rays of a frame, jumps over empty bricks included, and samples of matter among them."""
    jit = arrays()
    column, row = tile_place(dr.arange(jit.UInt, camera.width * camera.height), jit.UInt(camera.width))
    origin, direction = camera.rays(jit.Float(column) + 0.5, jit.Float(row) + 0.5)
    steps, samples = counted(Medium(boxes), origin, direction)
    return {"steps": int(dr.sum(steps)[0]), "samples": int(dr.sum(samples)[0])}


@dr.syntax
def counted(medium: Medium, origin: Any, direction: Any) -> tuple[Any, Any]:
    """Steps and samples of matter of every ray, as the march takes them."""
    jit, width = arrays(), dr.width(direction)
    crossing = medium.cross(origin, direction, jit.Float(0), jit.Float(dr.inf))
    state = crossing.start()
    passed, steps, samples = dr.ones(jit.Float, width), dr.zeros(jit.UInt, width), dr.zeros(jit.UInt, width)
    cut = END_TRANSMITTANCE * medium.tolerance
    while crossing.unfinished(state) & (passed > cut):
        step = medium.next(crossing, state)
        steps += 1
        if step.brick < 0:
            state = crossing.skip_empty(step, state)
        else:
            density, clearance = medium.density(step)
            depth = step.tau * density * step.length
            passed *= dr.select(crossing.must_split(state, depth), 1.0, dr.exp(-depth))
            samples += 1
            state = crossing.advance(step, depth, clearance, state)
        state = crossing.enter_next_box(state)
    return steps, samples
