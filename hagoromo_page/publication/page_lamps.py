"""Lamps and photographs of a page: the lamps of the capture in the page's axes, and photographs under them."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.light.colour import srgb_encode
from hagoromo.light.lamp import Lamp
from hagoromo.photograph.photograph import Photograph
from hagoromo_page.publication.surface_maps import FLIP, SurfaceMaps

JPEG_QUALITY = 82


@dataclass(frozen=True, eq=False)
class PageLamp:
    """A lamp of the capture, for the page's script.

    name; far: whether `at` (3,) is a direction to it, else its position [m], page's axes. axis: (4,) direction of its
    brightest light and exponent of the fall-off. colour: (C,) irradiance of a plane that faces it at the middle of the
    object, over that of the mean channel. level: that of the mean channel. to_lamp: (3,) direction from there.
    """

    name: str
    far: bool
    at: NDArray[np.float64]
    axis: tuple[float, ...]
    colour: tuple[float, ...]
    level: float
    to_lamp: NDArray[np.float64]

    def record(self) -> dict[str, Any]:
        """For the page's script."""
        at, axis, to_lamp = self.at.tolist(), list(self.axis), self.to_lamp.tolist()
        colour = list(self.colour)
        return {"name": self.name, "far": self.far, "at": at, "toLamp": to_lamp, "axis": axis, "colour": colour}


def page_lamp(lamp: Lamp, maps: SurfaceMaps, channels: int, with_spectrum: bool) -> PageLamp:
    """`lamp` in the page's axes. with_spectrum: its colour is that of its spectrum, not one of its intensity."""
    pose = maps.camera.world_to_camera
    turn = FLIP @ pose[:3, :3]
    middle = middle_of(maps)
    to_lamp, irradiance = lamp.direction_and_irradiance(middle)
    each = np.broadcast_to(np.asarray(irradiance, np.float64), channels)
    level = float(each.mean())
    colour = np.ones(channels) if with_spectrum or level <= 0.0 else each / level
    beam = lamp.beam
    axis = np.zeros(3) if beam.axis is None or beam.focus is None else turn @ beam.axis
    at = turn @ lamp.place + (FLIP @ pose[:3, 3] if lamp.near else 0.0)
    power = beam.focus or 0.0
    return PageLamp(
        lamp.name, not lamp.near, at, (*axis.tolist(), power), tuple(colour.tolist()), level, turn @ to_lamp
    )


def middle_of(maps: SurfaceMaps) -> NDArray[np.float64]:
    """The middle of the object (3,) [m], world: the mean of its points; one metre ahead where depth is not known."""
    rows, columns = np.nonzero(maps.known)
    depth = 1.0 if maps.depth is None else float(maps.depth[maps.known].mean())
    camera = maps.camera
    centre = np.array([columns.mean() + 0.5, rows.mean() + 0.5])
    ray = camera.unproject(centre) @ camera.world_to_camera[:3, :3].T
    ahead = ray / ray[2] * depth
    return camera.world_to_camera[:3, :3].T @ (ahead - camera.world_to_camera[:3, 3])


def photograph_picture(
    photograph: Photograph,
    maps: SurfaceMaps,
    to_display: NDArray[np.float64],
    gain: float,
    size: tuple[int, int],
) -> NDArray[np.uint8]:
    """sRGB picture of the part of `photograph` that the maps show, of `size` (width, height) [px].

    to_display: (3, C) from its values to linear sRGB. gain: exposure of the picture.
    """
    import cv2

    factor = photograph.camera.focal[0] / maps.camera.focal[0]
    top, left = round(maps.y), round(maps.x)
    height, width = round(maps.labels.shape[0] * factor), round(maps.labels.shape[1] * factor)
    part = np.nan_to_num(photograph.values[top : top + height, left : left + width].astype(np.float64))
    linear = np.clip(part @ to_display.T * gain, 0.0, 1.0)
    return srgb_encode(cv2.resize(linear, size, interpolation=cv2.INTER_AREA))


def jpeg_text(picture: NDArray[np.uint8], quality: int = JPEG_QUALITY) -> str:
    """A picture as the base64 of a JPEG."""
    import cv2

    _, encoded = cv2.imencode(".jpg", picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])
    return base64.b64encode(encoded.tobytes()).decode()


def chosen(photographs: Sequence[Photograph], most: int) -> list[Photograph]:
    """At most `most` photographs of one lamp, evenly from all."""
    single = [one for one in photographs if len(one.lamps) == 1]
    places = np.unique(np.linspace(0, len(single) - 1, min(most, len(single))).round().astype(int)) if single else []
    return [single[k] for k in places]
