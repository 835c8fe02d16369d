"""March: light from volume boxes along rays, one scattering event (MODEL §3, Tanaka eq. 11), and optical depth.

A sample stands for a step of half a voxel or, in dense matter, a part of it; its weight 1 − exp(−σΔ) makes an opaque
box tend to its surface exactly, and its light is taken at the centroid of exp(−σs) over the step. Rays end when less
than CUT of the light is left to gain; what is left is then taken to look like what was met.
"""

from __future__ import annotations

from typing import Any

import drjit as dr

from hagoromo.backend import arrays
from hagoromo.transport.crossing import Cone
from hagoromo.transport.lighting import Lighting
from hagoromo.transport.medium import THINNEST, Medium, Step

CUT = 4e-3  # transmittance, at TOLERANCE
DEEPEST = 16.0  # optical depth at which a lamp counts as hidden: exp(−16) = 1e-7


@dr.syntax
def march(
    medium: Medium,
    lighting: Lighting,
    origin: Any,
    direction: Any,
    near: Any,
    far: Any,
    phase: Any = 0.0,
    skip: bool = True,
    cone: Cone = (0.0, 0.0),
) -> Any:
    """Weights of the radiance towards the ray's origin (list of Float, one per channel) and the transmittance left.

    origin, direction (unit): Array3f, world. near, far: Float [m]. phase, cone: see `Medium.cross`.
    `skip=False` steps through empty bricks too.
    """
    crossing = medium.cross(origin, direction, near, far, phase, cone=cone)
    state = crossing.start()
    transmittance = dr.ones(arrays().Float, dr.width(direction))
    channels = [dr.zeros(arrays().Float, dr.width(direction)) for _ in range(lighting.materials.palette.channels)]
    cut = CUT * medium.tolerance
    while crossing.unfinished(state) & (transmittance > cut):
        step = medium.next(crossing, state)
        if step.brick < 0:
            state = crossing.skip_empty(step, state) if skip else crossing.next_sample(step, state)
        else:
            density, clear = medium.density(step)
            depth = step.tau * density * step.length
            if (depth > THINNEST) & ~crossing.must_split(state, depth):
                step.distance = step.centroid(depth)
                met = light_from_sample(medium, lighting, step, origin, direction)
                passed = dr.exp(-depth)
                gain = transmittance * (1.0 - passed)
                channels = added(channels, gain, met)
                transmittance *= passed
            state = crossing.advance(step, depth, clear, state)
        state = crossing.enter_next_box(state)
    ended = transmittance <= cut
    scale = dr.select(ended, 1.0 / (1.0 - transmittance), 1.0)
    return [channel * scale for channel in channels], dr.select(ended, 0.0, transmittance)


def added(channels: list[Any], gain: Any, met: list[Any]) -> list[Any]:
    """channels + gain · met (a comprehension over pairs may not stand in a `dr.syntax` function)."""
    return [dr.fma(gain, new, old) for new, old in zip(met, channels, strict=True)]


def light_from_sample(medium: Medium, lighting: Lighting, step: Step, origin: Any, direction: Any) -> list[Any]:
    """What the matter of one sample sends back along the ray: its weights, one per channel."""
    point = dr.fma(direction, step.distance, origin)
    elements, within = medium.elements(step)
    coefficients = [lighting.materials.coefficients(element.material) for element in elements]
    if lighting.painted:
        coefficients[0] = lighting.paint(coefficients[0], step.box, medium.colour(step))
    return lighting.reflected(point, -direction, elements, coefficients, within)


@dr.syntax
def optical_depth(
    medium: Medium, origin: Any, direction: Any, near: Any, far: Any, stride: float = 1.0, deepest: float = DEEPEST
) -> Any:
    """∫ σ du along rays from `near` to `far` [m], by brute march; ends beyond `deepest`. stride: see `Medium.cross`."""
    crossing = medium.cross(origin, direction, near, far, stride=stride)
    state = crossing.start()
    depth = dr.zeros(arrays().Float, dr.width(direction))
    while crossing.unfinished(state) & (depth < deepest):
        step = medium.next(crossing, state)
        if step.brick < 0:
            state = crossing.skip_empty(step, state)
        else:
            density, clear = medium.density(step)
            met = step.tau * density * step.length
            depth += dr.select(crossing.must_split(state, met), 0.0, met)
            state = crossing.advance(step, met, clear, state)
        state = crossing.enter_next_box(state)
    return depth
