"""Views: the values of every pixel of an object under one lamp each, from one fixed camera, as plain arrays.

Enters: a Capture. Leaves: values over the irradiance that faces the lamp, with variance and directions, for estimates
that use all pixels and lamps together (normals, unevenness of lamps, prediction under a held-out lamp).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError
from hagoromo.light.lamp import Lamp
from hagoromo.light.lamp_spread import LARGEST_CONDITION, condition_of
from hagoromo.measurement.normals.shadow_edges import lacking
from hagoromo.measurement.sight import light_of
from hagoromo.photograph.capture import Capture
from hagoromo.photograph.photograph import Photograph

Array = NDArray[np.float64]

FEWEST_LAMPS = 4  # three determine a Lambertian normal and leave no residual to judge it by
UNLIT = 1e-6  # of a lamp's largest irradiance: behind an LED it is 0, and nothing can be divided by it
CLIPPED = 0.98  # of the largest valid value of a photograph: masked values above are clipped
DARK = 3.0  # standard deviations of the sensor's noise: values below are shadow and carry little information


@dataclass(frozen=True, eq=False)
class Views:
    """K lamps, C channels, P pixels.

    values, variance: (K, C, P) radiance over irradiance facing the lamp [1/sr, up to the unit of the lamps], and the
    square of its noise. light: (K, C, P) that irradiance. used: (K, P) valid, above DARK, and of a pixel that is lit as
    a whole where three such are. to_lamp: (K, P, 3), to_eye: (P, 3) unit, world axes. points: (P, 3) [m] for which
    these hold; for far lamps anywhere on their rays. rows, columns: (P,) pixels of an image of `shape` (h, w). lamps:
    the K lamps. eye: (3,) [m] position of the camera; axis: (3,) unit, its viewing direction. lower: (K, C, P) values
    that are not valid because they are clipped, and so lower bounds; None: none are. lacks: (K, P) what the means of
    channels may lack at the edge of a cast shadow; None: nothing.
    """

    values: Array
    variance: Array
    light: Array
    used: NDArray[np.bool_]
    to_lamp: Array
    to_eye: Array
    points: Array
    rows: NDArray[np.intp]
    columns: NDArray[np.intp]
    shape: tuple[int, int]
    lamps: tuple[Lamp, ...]
    eye: Array
    axis: Array
    lower: NDArray[np.bool_] | None = None
    lacks: Array | None = None

    @property
    def place(self) -> Array:
        """(P, 2) position of the pixels from their centroid, in radii of a disc of as many pixels."""
        position = np.stack([self.columns, self.rows], axis=1).astype(np.float64)
        return (position - position.mean(axis=0)) / np.sqrt(len(position) / np.pi)

    def pixels(self, chosen: Any) -> Views:
        """The views of some pixels; of consecutive ones without a copy."""
        if chosen.dtype != bool and len(chosen) and np.all(np.diff(chosen) == 1):
            chosen = np.s_[int(chosen[0]) : int(chosen[-1]) + 1]
        return replace(
            self,
            values=self.values[..., chosen],
            variance=self.variance[..., chosen],
            light=self.light[..., chosen],
            used=self.used[:, chosen],
            to_lamp=self.to_lamp[:, chosen],
            to_eye=self.to_eye[chosen],
            points=self.points[chosen],
            rows=self.rows[chosen],
            columns=self.columns[chosen],
            lower=None if self.lower is None else self.lower[..., chosen],
            lacks=None if self.lacks is None else self.lacks[..., chosen],
        )

    def of_lamps(self, chosen: NDArray[np.bool_]) -> Views:
        """The views that use the photographs of some lamps (K,) only."""
        lower = None if self.lower is None else self.lower & chosen[:, None, None]
        return replace(self, used=self.used & chosen[:, None], lower=lower)

    def farther(self, times: float) -> Array:
        """(P, 3) the points at `times` their distance from the eye."""
        return self.eye + times * (self.points - self.eye)

    def under(self, lamps: tuple[Lamp, ...], times: float = 1.0) -> Views:
        """The same photographs, as if taken under `lamps` in place of the stated ones, at `times` the distance."""
        points, to_lamp, ratios = self.farther(times), [], []
        for lamp, stated in zip(lamps, self.lamps, strict=True):
            direction, after = lamp.direction_and_irradiance(points)
            before = stated.direction_and_irradiance(self.points)[1]
            least = UNLIT * before.max()
            to_lamp.append(direction)
            ratios.append((np.maximum(after, least) / np.maximum(before, least)).reshape(len(points), -1).T)
        ratio = np.stack(ratios)
        return replace(
            self,
            values=self.values / ratio,
            variance=self.variance / ratio**2,
            lacks=None if self.lacks is None else self.lacks / ratio.mean(axis=1),
            light=self.light * ratio,
            to_lamp=np.stack(to_lamp),
            points=points,
            lamps=lamps,
        )

    def valid(self, photographs: Sequence[Photograph]) -> NDArray[np.bool_]:
        """(K, P) whether the values of the photographs are valid, also those in shadow."""
        return np.stack([photograph.mask[self.rows, self.columns] for photograph in photographs])

    def image(self, pixels: NDArray, unknown: float = 0.0) -> NDArray:
        """(h, w, ...) image of (P, ...) values of the pixels."""
        whole = np.full((*self.shape, *pixels.shape[1:]), unknown, pixels.dtype)
        whole[self.rows, self.columns] = pixels
        return whole


@dataclass(frozen=True, eq=False)
class Stack:
    """The values of K photographs at P pixels, lamp by lamp: values, variance (K, P, C) and valid (K, P)."""

    values: NDArray[np.floating]
    variance: NDArray[np.floating]
    valid: NDArray[np.bool_]


def views_from_capture(capture: Capture) -> Views:
    """The views of a capture: pixels that are valid in most of its photographs and above DARK in three.

    Near lamps need `capture.points`. `InputError` when the photographs differ in camera or size, do not have one lamp
    each, have too few lamps, or lamps in one plane with the scene, from which normals are not identifiable.
    """
    photographs = capture.photographs
    check_lamps(photographs)
    rows, columns = np.nonzero(enough([photograph.mask for photograph in photographs]))
    if not len(rows):
        raise InputError(f"capture {capture.name!r} has no pixel that {FEWEST_LAMPS} photographs have valid")
    stack = Stack(
        np.stack([photograph.values[rows, columns] for photograph in photographs]),
        np.stack([photograph.variance[rows, columns] for photograph in photographs]),
        np.stack([photograph.mask[rows, columns] for photograph in photographs]),
    )
    points = _points(capture, rows, columns)
    lamps = tuple(photograph.lamps[0] for photograph in photographs)
    selected = views_from_stack(stack, photographs[0].camera, lamps, points, (rows, columns))
    if condition_of(selected.to_lamp.mean(axis=1)) > LARGEST_CONDITION:
        raise InputError(f"the lamps of capture {capture.name!r} lie in one plane with the scene: move one out of it")
    if not len(selected.rows):
        raise InputError(f"capture {capture.name!r} has no pixel that three lamps light: expose longer")
    return replace(selected, lower=_clipped(photographs, selected.rows, selected.columns))


def _clipped(
    photographs: Sequence[Photograph], rows: NDArray[np.intp], columns: NDArray[np.intp]
) -> NDArray[np.bool_] | None:
    """`lower` of `Views`."""
    lower = np.zeros((len(photographs), photographs[0].values.shape[2], len(rows)), bool)
    for clipped, photograph in zip(lower, photographs, strict=True):
        masked = ~photograph.mask[rows, columns]
        top = photograph.values[photograph.mask].max(initial=0.0)
        if top > 0.0 and masked.any():
            clipped[:] = masked & (np.nan_to_num(photograph.values[rows, columns].T) >= CLIPPED * top)
    return lower if lower.any() else None


def views_from_stack(
    stack: Stack,
    camera: Camera,
    lamps: tuple[Lamp, ...],
    points: Array,
    pixels: tuple[NDArray[np.intp], NDArray[np.intp]],
) -> Views:
    """The views of some `pixels` (rows, columns) of one camera, at surface `points` (P, 3), where three lamps light."""
    values, variance, lights, used, to_lamp = [], [], [], [], []
    for k, lamp in enumerate(lamps):
        value, noise = (part[k].astype(np.float64) for part in (stack.values, stack.variance))
        direction, light = light_of(lamp, camera, value.shape[1], points)
        light = np.maximum(light, UNLIT * light.max())
        used.append(stack.valid[k] & (value.mean(axis=1) > DARK * np.sqrt(noise.mean(axis=1))))
        values.append((value / light).T)
        variance.append((noise / light**2).T)
        lights.append(light.T)
        to_lamp.append(direction)
    to_eye = camera.position - points
    to_eye /= np.linalg.norm(to_eye, axis=1, keepdims=True)
    bright, seen = np.stack(used), np.stack(values)
    edge = lacking(seen.mean(axis=1), bright, stack.valid, pixels)
    whole = bright & (edge == 0.0)
    bright = np.where(whole.sum(axis=0) >= 3, whole, bright)
    selected = Views(
        values=seen,
        variance=np.stack(variance),
        light=np.stack(lights),
        used=bright,
        to_lamp=np.stack(to_lamp),
        to_eye=to_eye,
        points=points,
        rows=pixels[0],
        columns=pixels[1],
        shape=(camera.height, camera.width),
        lamps=lamps,
        eye=camera.position,
        axis=camera.camera_to_world[:3, 2],
        lacks=edge if edge.any() else None,
    )
    return selected.pixels(bright.sum(axis=0) >= 3)


def enough(masks: Sequence[NDArray[np.bool_]]) -> NDArray[np.bool_]:
    """Pixels that are valid in most of the photographs, and in at least FEWEST_LAMPS."""
    return np.sum(masks, axis=0) >= max(FEWEST_LAMPS, len(masks) / 2)


def check_lamps(photographs: Sequence[Photograph], fewest: int = FEWEST_LAMPS) -> None:
    """`InputError` unless the photographs have one lamp each, one camera and size, and are `fewest` or more."""
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
    if len(photographs) < fewest:
        raise InputError(f"{len(photographs)} photographs do not determine normals: give {FEWEST_LAMPS} lamps or more")


def _points(capture: Capture, rows: NDArray[np.intp], columns: NDArray[np.intp]) -> Array:
    """(P, 3) [m] points of the pixels; anywhere on their rays for far lamps."""
    camera = capture.photographs[0].camera
    anywhere = camera.position + camera.pixel_directions()[rows, columns]
    if capture.points is not None:
        points = capture.points[rows, columns].astype(np.float64)
        return np.where((points == 0.0).all(axis=1, keepdims=True), anywhere, points)  # 0 where unknown
    for photograph in capture.photographs:
        if photograph.lamps[0].position is not None:
            raise InputError(f"capture {capture.name!r} has near lamps and no points: give points_path, if rough")
    return anywhere
