"""Steps: how many turns the march of a frame's camera rays takes, and how many samples it lights.

A turn of the loop finds an interval and closes the one before, so a ray has one turn more than intervals.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import drjit as dr

import hagoromo as hg
from hagoromo.backend import arrays
from hagoromo.image.prepared.prepared_scene import PreparedScene
from hagoromo.image.scene.settings import Settings
from hagoromo.transport.film import tile_place
from hagoromo.transport.lighting import Lighting
from hagoromo.transport.march import march, optical_depth
from hagoromo.transport.medium import Medium


def steps_of(boxes: Sequence[hg.VolumeBox], camera: hg.Camera, lamps: Sequence[hg.Lamp]) -> dict[str, int]:
    """Turns of all rays of a frame without shadows, those in empty bricks included, and lit samples of matter."""
    jit = arrays()
    column, row = tile_place(dr.arange(jit.UInt, camera.width * camera.height), jit.UInt(camera.width))
    rays = camera.rays(jit.Float(column) + 0.5, jit.Float(row) + 0.5)
    prepared = PreparedScene(hg.Scene(camera, tuple(lamps), tuple(boxes)), Settings(shadows="none"))
    steps, samples = counts_of_march(boxes, prepared.lighting, *rays)
    return {"steps": int(dr.sum(steps)[0]), "samples": int(dr.sum(samples)[0])}


def counts_of_march(boxes: Sequence[hg.VolumeBox], lighting: Lighting, origin: Any, direction: Any) -> tuple[Any, Any]:
    """Turns and lit samples of every ray of a march, as the march itself takes them."""
    jit, medium = arrays(), CountingMedium(boxes, dr.width(direction))
    march(medium, lighting, origin, direction, jit.Float(0), jit.Float(dr.inf))
    return medium.counts()


def counts_of_walk(boxes: Sequence[hg.VolumeBox], origin: Any, direction: Any, deepest: float) -> Any:
    """Turns of every ray whose optical depth is computed up to `deepest`: one an interval."""
    jit, medium = arrays(), CountingMedium(boxes, dr.width(direction))
    optical_depth(medium, origin, direction, jit.Float(0), jit.Float(dr.inf), deepest)
    return medium.counts()[0]


class CountingMedium(Medium):
    """A medium that counts how often each of `rays` rays asks for an interval and for a sample to light."""

    def __init__(self, boxes: Sequence[hg.VolumeBox], rays: int) -> None:
        super().__init__(boxes)
        self.steps, self.samples = (dr.zeros(arrays().UInt, rays) for _ in range(2))
        self.lane = dr.arange(arrays().UInt, rays)
        dr.eval(self.steps, self.samples, self.lane)

    def next(self, crossing: Any, state: Any) -> Any:
        """As `Medium.next`."""
        dr.scatter_add(self.steps, 1, self.lane)
        return super().next(crossing, state)

    def elements(self, step: Any, direction: Any) -> Any:
        """As `Medium.elements`."""
        dr.scatter_add(self.samples, 1, self.lane)
        return super().elements(step, direction)

    def counts(self) -> tuple[Any, Any]:
        """Turns and samples of every ray so far."""
        dr.eval(self.steps, self.samples)
        return self.steps, self.samples
