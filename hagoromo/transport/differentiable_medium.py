"""A medium whose light can be differentiated by densities and axes, in forward mode.

Enters: boxes. Leaves: the medium that `march` takes, with voxels in single precision, and its shadows. It differs from
`Medium` in what a derivative needs:

* Dr.Jit 1.5 loses derivatives of what an inner branch or loop takes from the code around it. It fails where they are
  nested four deep, or where two loops follow each other in a third. So nothing branches inside the march: both ways
  are computed, and one is chosen. One loop marches to all lamps, with the rays in its state.
* Steps are those of LARGEST_TOLERANCE or less: in dense matter the derivative is small beside the light, and so are
  errors that it may have.
* A ray goes on to OPAQUE_OPTICAL_DEPTH: an end at 1 % of the light would cut off the derivative of what is behind.
* Cells without matter have a density of 1e-10 and a sample, so that light of matter that comes there has a derivative.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import drjit as dr
import numpy as np

from hagoromo.backend import Array3f, Bool, Float, arrays, column
from hagoromo.errors import InputError
from hagoromo.transport.crossing import Cone, Crossing, MarchInterval, MarchState, selected
from hagoromo.transport.frames import DEFAULT_TOLERANCE
from hagoromo.transport.lighting import AttenuationOfAll, ShadowRay
from hagoromo.transport.march import OPAQUE_OPTICAL_DEPTH
from hagoromo.transport.medium import LEAST_DEPTH, Limit, Medium
from hagoromo.volume.box import VolumeBox
from hagoromo.volume.voxels import VOXELS, PlainVoxels

LARGEST_TOLERANCE = 0.0025  # at which derivatives are right to 1 %: tests/gradients


class DifferentiableMedium(Medium):
    """The boxes of a scene on the device. `InputError` for boxes of texels, which need packed voxels."""

    differentiable = True
    branches = False  # whether code branches: where nothing is differentiated across a branch, see `searching`
    marched_back: AttenuationOfAll | None = None  # shadows of `adjoint`, in place of those in forward mode

    def __init__(self, boxes: Sequence[VolumeBox], tolerance: float = DEFAULT_TOLERANCE) -> None:
        super().__init__(boxes, min(tolerance, LARGEST_TOLERANCE))
        self.voxels = plain_voxels(self.boxes)
        self.empty, self.negligible = self.negligible, dr.opaque(arrays().Float, LEAST_DEPTH)

    def cross(
        self,
        origin: Array3f,
        direction: Array3f,
        near: Float,
        far: Float,
        phase: Float = 0.0,
        cone: Cone = (0.0, 0.0),
    ) -> Crossing:
        """See `Medium.cross`."""
        crossing = super().cross(origin, direction, near, far, phase, cone)
        crossing.branches = self.branches
        return crossing

    def searching(self) -> DifferentiableMedium:
        """The same medium with branches, for what is not differentiated: steps are found sooner."""
        medium = copy.copy(self)
        medium.branches = True
        return medium

    def branch(self, arguments: tuple, condition: Bool, yes: Callable, no: Callable) -> Any:
        """Both ways, of which `condition` chooses one; or a branch, see `searching`."""
        if self.branches:
            return super().branch(arguments, condition, yes, no)
        return selected(condition, yes(*arguments), no(*arguments))

    def without_matter(self, depth: Float) -> Bool:
        """See `Medium.without_matter`."""
        return depth <= self.empty

    def _in_cell(self, step: MarchInterval, direction: Array3f, limit: Limit | None) -> MarchInterval:
        stored = replace(step, brick=dr.maximum(step.brick, 0))  # empty bricks are computed, too, and not chosen
        return replace(super()._in_cell(stored, direction, limit), brick=step.brick)


def plain_voxels(boxes: Sequence[VolumeBox]) -> PlainVoxels:
    """The voxels of all boxes in single precision; `InputError` for boxes of texels."""
    bricks = list({id(box.bricks): box.bricks for box in boxes}.values())
    if any(part.chart is not None for part in bricks):
        raise InputError("a box of texels cannot be differentiated by its voxels: build it without texels")
    count = max(1, *(part.density.first + part.kept for part in bricks))  # kernels read a brick where none is stored
    values = np.zeros((count, VOXELS, 4), np.float32)
    for part in (part for part in bricks if part.kept):
        held = part.read(0, part.kept)
        place = slice(part.density.first, part.density.first + part.kept)
        values[place, :, 0] = held["density"].reshape(part.kept, VOXELS)
        values[place, :, 1:] = held["axis"].reshape(part.kept, VOXELS, 3)
    return PlainVoxels(column(arrays().Float, values))


def differentiable_attenuation(medium: Medium) -> AttenuationOfAll:
    """`AttenuationOfAll` by marching from every point to the lamps, with derivatives by voxels and by the rays."""

    def transmittances(rays: list[ShadowRay]) -> list[Float]:
        if isinstance(medium, DifferentiableMedium) and medium.marched_back is not None:
            return medium.marched_back(rays)
        return [dr.exp(-depth) for depth in optical_depths(medium, rays)]

    return transmittances


@dr.syntax
def optical_depths(medium: Medium, rays: list[ShadowRay]) -> list[Float]:
    """∫ σ du of rays that move, side by side in one loop; see `march.optical_depth`."""
    states = [crossing_of(medium, ray).start() for ray in rays]
    depths = [dr.zeros(arrays().Float, dr.width(ray)) for ray in rays]
    while any_unfinished(medium, rays, states, depths):
        for k in range(len(rays)):
            crossing = crossing_of(medium, rays[k])
            step = medium.extinction(medium.next(crossing, states[k]), rays[k][1])
            depths[k] = depths[k] + step.depth
            states[k] = crossing.enter_next_box(crossing.advance(step, states[k]))
    return depths


def crossing_of(medium: Medium, ray: ShadowRay) -> Crossing:
    """A ray to a lamp through all boxes."""
    origin, to_lamp, distance = ray
    return medium.cross(origin, to_lamp, arrays().Float(0), distance)


def any_unfinished(medium: Medium, rays: list[ShadowRay], states: list[MarchState], depths: list[Float]) -> Bool:
    """Whether one of several rays has an interval left in front of OPAQUE_OPTICAL_DEPTH."""
    left = arrays().Bool(False)
    for ray, state, depth in zip(rays, states, depths, strict=True):
        left |= crossing_of(medium, ray).unfinished(state) & (depth < OPAQUE_OPTICAL_DEPTH)
    return left
