"""March: light from volume boxes along rays, one scattering event (MODEL §3, Tanaka eq. 11), and optical depth.

A step is half a voxel long or, in dense matter, shorter. Its sample has the weight 1 − exp(−σΔ), by which an opaque box
tends to its surface exactly, and is lit at the centroid of exp(−σs) over the step. A ray ends at END_TRANSMITTANCE: its
radiance is then divided by 1 − transmittance, as if the matter behind looked like the matter in front.
"""

from __future__ import annotations

import drjit as dr

from hagoromo.backend import Array3f, Float, arrays
from hagoromo.transport.crossing import Cone
from hagoromo.transport.lighting import Lighting
from hagoromo.transport.medium import NEGLIGIBLE_OPTICAL_DEPTH, Medium, Step

END_TRANSMITTANCE = 4e-3  # a ray ends below this transmittance, at DEFAULT_TOLERANCE
OPAQUE_OPTICAL_DEPTH = 16.0  # a shadow ray ends beyond this optical depth: exp(−16) = 1e-7


@dr.syntax
def march(
    medium: Medium,
    lighting: Lighting,
    origin: Array3f,
    direction: Array3f,
    near: Float,
    far: Float,
    phase: Float = 0.0,
    skip: bool = True,
    cone: Cone = (0.0, 0.0),
) -> tuple[list[Float], Float]:
    """Weights of the radiance towards the ray's origin (list of Float, one per channel) and the transmittance left.

    origin, direction (unit): Array3f, world. near, far: Float [m]. phase, cone: see `Medium.cross`.
    `skip=False` steps through empty bricks too.
    """
    crossing = medium.cross(origin, direction, near, far, phase, cone=cone)
    state = crossing.start()
    transmittance = dr.ones(arrays().Float, dr.width(direction))
    channels = [dr.zeros(arrays().Float, dr.width(direction)) for _ in range(lighting.materials.palette.channels)]
    cut = END_TRANSMITTANCE * medium.tolerance
    while crossing.unfinished(state) & (transmittance > cut):
        step = medium.next(crossing, state)
        if step.brick < 0:
            state = crossing.skip_empty(step, state) if skip else crossing.next_sample(step, state)
        else:
            extinction, clearance = medium.extinction(step, crossing.direction)
            depth = extinction * step.length
            if (depth > NEGLIGIBLE_OPTICAL_DEPTH) & ~crossing.must_split(state, depth):
                step.distance = step.centroid(depth)
                radiance = radiance_from_sample(medium, lighting, step, origin, direction)
                step_transmittance = dr.exp(-depth)
                gain = transmittance * (1.0 - step_transmittance)
                channels = accumulated(channels, gain, radiance)
                transmittance *= step_transmittance
            state = crossing.advance(step, depth, clearance, state)
        state = crossing.enter_next_box(state)
    ended = transmittance <= cut
    scale = dr.select(ended, 1.0 / (1.0 - transmittance), 1.0)
    return [channel * scale for channel in channels], dr.select(ended, 0.0, transmittance)


def accumulated(channels: list[Float], gain: Float, radiance: list[Float]) -> list[Float]:
    """channels + gain · radiance (a `dr.syntax` function may not hold a comprehension over pairs)."""
    return [dr.fma(gain, new, old) for new, old in zip(radiance, channels, strict=True)]


def radiance_from_sample(
    medium: Medium, lighting: Lighting, step: Step, origin: Array3f, direction: Array3f
) -> list[Float]:
    """Radiance that the matter of one sample sends back along the ray: its weights, one per channel."""
    point = dr.fma(direction, step.distance, origin)
    elements, texel_hit = medium.elements(step, direction)
    coefficients = [lighting.materials.coefficients(element.material) for element in elements]
    if lighting.voxel_bases:
        coefficients[0] = lighting.with_voxel_colour(coefficients[0], step.box, medium.colour(step))
    return lighting.reflected_radiance(point, -direction, elements, coefficients, texel_hit)


@dr.syntax
def optical_depth(
    medium: Medium,
    origin: Array3f,
    direction: Array3f,
    near: Float,
    far: Float,
    stride: float = 1.0,
    deepest: float = OPAQUE_OPTICAL_DEPTH,
) -> Float:
    """∫ σ du along rays from `near` to `far` [m], by marching; it ends beyond `deepest`. stride: see `Medium.cross`."""
    crossing = medium.cross(origin, direction, near, far, stride=stride)
    state = crossing.start()
    depth = dr.zeros(arrays().Float, dr.width(direction))
    while crossing.unfinished(state) & (depth < deepest):
        step = medium.next(crossing, state)
        if step.brick < 0:
            state = crossing.skip_empty(step, state)
        else:
            extinction, clearance = medium.extinction(step, crossing.direction)
            step_depth = extinction * step.length
            depth += dr.select(crossing.must_split(state, step_depth), 0.0, step_depth)
            state = crossing.advance(step, step_depth, clearance, state)
        state = crossing.enter_next_box(state)
    return depth
