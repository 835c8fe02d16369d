"""Views: what one camera in one place saw of every pixel of an object, a lamp at a time, as plain arrays.

Enters: a Capture. Leaves: values over the irradiance that faces the lamp, with variance and directions, for the
estimates that take pixels and lamps together (normals, unevenness of lamps, prediction under a lamp kept aside).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.response import white
from hagoromo.errors import InputError
from hagoromo.photograph.capture import Capture
from hagoromo.photograph.photograph import Photograph

Array = NDArray[np.float64]

FEWEST_LAMPS = 4  # three give a Lambertian normal and nothing to judge it by
COPLANAR = 0.05  # smallest singular value of the lamps' directions over the largest, below which one plane holds them
DARK = 3.0  # standard deviations of the sensor's noise: a value below is shadow and says little of the normal


@dataclass(frozen=True, eq=False)
class Views:
    """K lamps, C channels, P pixels.

    values, variance: (K, C, P) radiance over irradiance facing the lamp [1/sr, up to the unit of the lamps], and the
    square of its noise. light: (K, C, P) that irradiance. used: (K, P) valid and above the dark. to_lamp: (K, P, 3),
    to_eye: (P, 3) unit, world axes.
    rows, columns: (P,) pixels of an image of `shape` (h, w).
    """

    values: Array
    variance: Array
    light: Array
    used: NDArray[np.bool_]
    to_lamp: Array
    to_eye: Array
    rows: NDArray[np.intp]
    columns: NDArray[np.intp]
    shape: tuple[int, int]

    @property
    def place(self) -> Array:
        """(P, 2) where the pixels are in the image, from their middle, in radii of a disc of as many pixels."""
        at = np.stack([self.columns, self.rows], axis=1).astype(np.float64)
        return (at - at.mean(axis=0)) / np.sqrt(len(at) / np.pi)

    def pixels(self, chosen: NDArray) -> Views:
        """The views of some pixels."""
        return replace(
            self,
            values=self.values[..., chosen],
            variance=self.variance[..., chosen],
            light=self.light[..., chosen],
            used=self.used[:, chosen],
            to_lamp=self.to_lamp[:, chosen],
            to_eye=self.to_eye[chosen],
            rows=self.rows[chosen],
            columns=self.columns[chosen],
        )

    def lamps(self, chosen: NDArray | list[int]) -> Views:
        """The views under some lamps."""
        parts = {name: getattr(self, name)[chosen] for name in ("values", "variance", "light", "used", "to_lamp")}
        return replace(self, **parts)

    def image(self, pixels: NDArray, unknown: float = 0.0) -> NDArray:
        """(h, w, ...) image of (P, ...) values of the pixels."""
        whole = np.full((*self.shape, *pixels.shape[1:]), unknown, pixels.dtype)
        whole[self.rows, self.columns] = pixels
        return whole


def views(capture: Capture) -> Views:
    """The views of a capture: pixels that most of its photographs have valid and three see above the dark.

    Near lamps need `capture.points`. `InputError` when the photographs differ in camera or size, have other than one
    lamp each, too few lamps, or lamps in one plane with the scene, between which normals cannot be told.
    """
    photographs = capture.photographs
    first = photographs[0]
    for photograph in photographs:
        if len(photograph.lamps) != 1:
            raise InputError(
                f"photograph {photograph.name!r} has {len(photograph.lamps)} lamps: normals need one lamp each"
            )
        if photograph.values.shape != first.values.shape or not np.allclose(
            photograph.camera.matrix, first.camera.matrix, rtol=1e-6
        ):
            raise InputError(f"photograph {photograph.name!r} is of another camera or size: normals need a fixed one")
    if len(photographs) < FEWEST_LAMPS:
        raise InputError(f"{len(photographs)} photographs cannot tell normals: give {FEWEST_LAMPS} lamps or more")
    masks = np.stack([photograph.mask for photograph in photographs])
    rows, columns = np.nonzero(masks.sum(axis=0) >= max(FEWEST_LAMPS, len(masks) / 2))
    if not len(rows):
        raise InputError(f"capture {capture.name!r} has no pixel that {FEWEST_LAMPS} photographs have valid")
    points = _points(capture, rows, columns)
    values, variance, lights, used, to_lamp = [], [], [], [], []
    for photograph in photographs:
        direction, light = _light(photograph, points)
        value = photograph.values[rows, columns].astype(np.float64)
        noise = photograph.variance[rows, columns].astype(np.float64)
        above = value.mean(axis=1) > DARK * np.sqrt(noise.mean(axis=1))
        used.append(photograph.mask[rows, columns] & above)
        values.append((value / light).T)
        variance.append((noise / light**2).T)
        lights.append(light.T)
        to_lamp.append(direction)
    directions = np.stack(to_lamp)
    spread = np.linalg.svd(directions.mean(axis=1), compute_uv=False)
    if spread[2] < COPLANAR * spread[0]:
        raise InputError(f"the lamps of capture {capture.name!r} lie in one plane with the scene: move one out of it")
    to_eye = -first.camera.pixel_directions()[rows, columns]
    shape = (first.camera.height, first.camera.width)
    bright = np.stack(used)
    seen = Views(
        np.stack(values), np.stack(variance), np.stack(lights), bright, directions, to_eye, rows, columns, shape
    )
    told = bright.sum(axis=0) >= 3
    if not told.any():
        raise InputError(f"capture {capture.name!r} has no pixel that three lamps light: expose longer")
    return seen.pixels(told)


def _light(photograph: Photograph, points: Array) -> tuple[Array, Array]:
    """Directions to the lamp (P, 3) and its irradiance (P, C) as the channels see it."""
    lamp, response = photograph.lamps[0], photograph.camera.response
    direction, irradiance = lamp.direction_and_irradiance(points)
    scale = np.ones(photograph.values.shape[2]) if response is None else white(lamp.spectrum, response)
    return direction, (irradiance if irradiance.ndim == 2 else irradiance[:, None]) * scale


def _points(capture: Capture, rows: NDArray[np.intp], columns: NDArray[np.intp]) -> Array:
    """(P, 3) [m] where the pixels are; anywhere on their rays for far lamps."""
    if capture.points is not None:
        return capture.points[rows, columns].astype(np.float64)
    for photograph in capture.photographs:
        if photograph.lamps[0].position is not None:
            raise InputError(f"capture {capture.name!r} has near lamps and no points: give points_path, if rough")
    camera = capture.photographs[0].camera
    return camera.position + camera.pixel_directions()[rows, columns]
