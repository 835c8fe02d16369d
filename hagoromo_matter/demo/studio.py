"""Studio: arrangement for photographs of matter: position of the camera, three lamps and a plain background."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.camera import Camera
from hagoromo.image.scene.surface import Surface
from hagoromo.light.lamp import Lamp
from hagoromo.light.spectrum import Spectrum
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.volume.box import VolumeBox
from hagoromo_matter.demo.sweep import sweep

STUDIO_SPECTRUM = "D65"


def turned_upright(camera: Camera) -> Camera:
    """The camera turned on its side, its picture shown upright."""
    (ax, ay), (x0, y0) = camera.focal, camera.principal
    return replace(camera, width=camera.height, height=camera.width, focal=(ay, ax), principal=(y0, x0))


def framed(camera: Camera, boxes: Sequence[VolumeBox], towards: Sequence[float], filled: float) -> Camera:
    """The camera in direction `towards` from the boxes, where their corners span `filled` of the image."""
    corners = np.concatenate([box.corners() for box in boxes])
    aim, extent = ball_around(boxes)
    direction, distance = np.asarray(towards, float) / np.linalg.norm(towards), 5.0 * extent
    for _ in range(20):
        placed = camera.look_at(aim + direction * distance, aim)
        projected = (placed.project(corners) - camera.principal) / camera.focal
        low, high = projected.min(axis=0), projected.max(axis=0)
        across = np.append(0.5 * (low + high) * distance, 0.0)
        aim = aim + across @ placed.world_to_camera[:3, :3]
        span = float(np.max((high - low) * camera.focal / (camera.width, camera.height)))
        distance = max(distance * span / filled, 1.01 * extent)
    return camera.look_at(aim + direction * distance, aim)


def studio_lamps(middle: NDArray, extent: float) -> tuple[Lamp, ...]:
    """Three white point lamps: key high on the left, weak fill beside the camera and low, rim from high behind.

    Places in units of `extent` [m] from `middle`, and irradiance there, 1 for the key.
    """
    places = {"key": ((-2.2, -2.7, 2.5), 1.0), "fill": ((0.25, -4.4, -0.3), 0.18), "rim": ((1.1, 1.6, 3.4), 1.0)}
    return tuple(
        Lamp(
            position=middle + extent * np.array(place),
            intensity=share * float(np.dot(place, place)) * extent**2,
            spectrum=Spectrum.named(STUDIO_SPECTRUM),
            name=name,
        )
        for name, (place, share) in places.items()
    )


def background(extent: float, reflectance: Reflectance) -> Surface:
    """A sweep on z = 0 whose wall is far behind an object of size `extent` [m]."""
    return sweep(reflectance, (-40.0 * extent, 0.0), (13.0 * extent, 40.0 * extent), 4.0 * extent, 40.0 * extent)


def ball_around(boxes: Sequence[VolumeBox]) -> tuple[NDArray, float]:
    """Centre [m] and half diagonal [m] of the bounds of the boxes."""
    corners = np.concatenate([box.corners() for box in boxes])
    low, high = corners.min(axis=0), corners.max(axis=0)
    return 0.5 * (low + high), 0.5 * float(np.linalg.norm(high - low))
