"""Moving: rays and lamps that the light of a sample is differentiated by.

They are the same for all samples of a ray, so each ray sums their derivative over its samples; nothing is scattered.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import drjit as dr

from hagoromo.backend import Array3f, Float
from hagoromo.light.lamp_light import LampLight
from hagoromo.transport.crossing import MarchInterval, Ray


@dataclass
class Rays:
    """Rays in the world, counted from the origin of the scene, up to a distance [m]."""

    origin: Array3f
    direction: Array3f  # unit
    far: Float


class Moving:
    """Whether rays move, and which lamps do. A plain object: loops do not take its arrays into their state.

    count: of the numbers per ray whose derivative is summed: origin and direction of the ray, then place and intensity
    of every lamp.
    """

    def __init__(self, rays: bool, lamps: Sequence[LampLight], width: int) -> None:
        self.rays, self.lamps, self.width = rays, lamps, width
        self.fixed = [(lamp.where, lamp.intensity) for lamp in lamps]
        self.count = 6 * rays + 4 * len(lamps)
        self._tracked: list[Any] = []

    def track(self, rays: Rays) -> Rays:
        """The rays, tracked if they move; lamps are tracked from here to `gradients`."""
        self._tracked = []
        if self.rays:
            rays = replace(rays, origin=self._track(rays.origin), direction=self._track(rays.direction))
        for lamp, (where, intensity) in zip(self.lamps, self.fixed, strict=True):
            lamp.where, lamp.intensity = self._track(where), self._track(intensity)
        return rays

    def gradients(self) -> list[Float]:
        """Of all that is tracked, one Float per number; lamps are as they were afterwards."""
        numbers: list[Float] = []
        for each in self._tracked:
            gradient = dr.grad(each)
            numbers += [gradient] if dr.depth_v(gradient) == 1 else list(gradient)
        self.release()
        return numbers

    def release(self) -> None:
        """Lamps as they were."""
        for lamp, fixed in zip(self.lamps, self.fixed, strict=True):
            lamp.where, lamp.intensity = fixed

    def _track(self, values: Any) -> Any:
        """A copy that is tracked, with an entry per ray."""
        each = dr.detach(values) + dr.zeros(type(values), self.width)
        dr.enable_grad(each)
        self._tracked.append(each)
        return each


def on_ray(ray: Ray, step: MarchInterval) -> MarchInterval:
    """A step on its ray, which is tracked. Ends of steps stay where they are from the entry of the ray in the box; only
    the last one is where the ray leaves it. Density is the same on both sides of all others.
    """
    return replace(step, ray=ray, end=dr.select(step.end >= step.ray.far, ray.far, step.end))
