"""Seen surface: what a measurement knows of its surface, pixel by pixel, with errors and the unit of lengths."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError
from hagoromo.measurement.error_files import SharedErrors
from hagoromo.measurement.inspection.footprint import unevenness
from hagoromo.measurement.measurement import Measurement
from hagoromo.measurement.normals.pixel_errors import UNKNOWN_DIRECTION
from hagoromo.measurement.photographed import Photographed
from hagoromo.measurement.scale import has_scale
from hagoromo.measurement.squares import square_means
from hagoromo.measurement.surface.graph import graph

Array = NDArray[np.float64]
MAPS = ("known", "points", "normals", "body", "body_error", "own_variance", "summed_variance")


@dataclass(frozen=True, eq=False)
class SeenSurface:
    """A surface of h × w pixels that one camera sees.

    known: (h, w) of the object. points: (h, w, 3) [m], normals: (h, w, 3), unit, body: (h, w, C) α c_b [1/sr] and its
    standard error; 0 where unknown. World axes.
    own_variance: (h, w) [rad²] of the normals' direction, of the errors that are each pixel's own; summed_variance: of
    what counts in sums over pixels, which is more where normals were smoothed. shared: what all pixels have in common.
    These are None where the shape was given. in_metres: whether lengths are metres; else their unit is unknown.
    """

    camera: Camera
    known: NDArray[np.bool_]
    points: Array
    normals: Array
    body: Array | None
    body_error: Array | None
    own_variance: Array | None
    summed_variance: Array | None
    shared: SharedErrors | None
    in_metres: bool

    @cached_property
    def away(self) -> Array:
        """(h, w) distance from the camera [m]."""
        return np.linalg.norm(self.points - self.camera.position, axis=2)

    @cached_property
    def pitch(self) -> float:
        """Distance of neighbouring pixels on the object [m], the median."""
        return float(np.median(self.away[self.known]) / np.mean(self.camera.focal))

    @property
    def unit(self) -> str:
        """Of lengths: mm, or px where the scale is unknown."""
        return "mm" if self.in_metres else "px"

    @property
    def units_per_metre(self) -> float:
        """`unit` of a metre."""
        return 1e3 if self.in_metres else 1.0 / self.pitch

    @cached_property
    def parts(self) -> NDArray[np.intp]:
        """(h, w) number of the part of each pixel, which are joined without a step; −1 where unknown."""
        net = graph(self.normals, self.camera, self.known, self.own_variance)
        pose, numbers = self.camera.world_to_camera, np.full(self.known.shape, -1)
        depth = self.points[self.known] @ pose[2, :3] + pose[2, 3]
        numbers[self.known] = net.stepped(np.log(depth)).parts
        return numbers

    def part(self, rows: slice, columns: slice) -> SeenSurface:
        """Only the pixels in `rows` and `columns`."""
        maps = {key: one[rows, columns] for key, one in self._maps().items()}
        height, width = maps["known"].shape
        camera = self.camera.resampled(width, height, (1.0, 1.0), (float(columns.start), float(rows.start)))
        shared = self.shared
        if shared is not None:
            shared = SharedErrors(shared.normals[:, rows, columns], shared.distance[:, rows, columns])
        return replace(self, camera=camera, shared=shared, **maps)

    def averaged(self, step: int) -> SeenSurface:
        """Of means over squares of `step` pixels that are known throughout; those at the edge may be left out."""
        if step == 1:
            return self
        maps = {key: square_means(one.astype(np.float64), step) for key, one in self._maps().items()}
        known = np.asarray(maps.pop("known") > 1.0 - 1e-9)
        maps = {key: np.where(known if one.ndim == 2 else known[..., None], one, 0.0) for key, one in maps.items()}
        maps |= {key: one / step**2 for key, one in maps.items() if key.endswith("variance")}
        maps["normals"] /= np.maximum(np.linalg.norm(maps["normals"], axis=2, keepdims=True), 1e-12)
        camera = self.camera.resampled(known.shape[1], known.shape[0], (step, step))
        shared = self.shared
        if shared is not None:
            parts = (np.stack([square_means(one, step) for one in of]) for of in (shared.normals, shared.distance))
            shared = SharedErrors(*(one.astype(np.float32) for one in parts))
        return replace(self, camera=camera, known=known, shared=shared, **maps)

    def sharpened(self) -> SeenSurface:
        """With what the width of the pixels took away from grooves and ridges, where the shape was integrated."""
        if self.own_variance is None:
            return self
        lost = unevenness(self.normals, self.camera, self.known, self.own_variance).lost
        ray = self.points - self.camera.position
        points = np.where(self.known[..., None], self.camera.position + np.exp(lost)[..., None] * ray, 0.0)
        return replace(self, points=points)

    def _maps(self) -> Mapping[str, NDArray]:
        return {key: getattr(self, key) for key in MAPS if getattr(self, key) is not None}


def seen_surface(measurement: Measurement, taken: Photographed | None = None) -> SeenSurface:
    """The surface of `measurement`; `InputError` where it has no points, no camera or no pixel of an object.

    taken: camera and lamps, by default those that the measurement states.
    """
    taken, fine = taken or measurement.photographed_with, measurement.fine
    source = measurement if fine is None else fine
    points, labels = source.points, source.labels
    if points is None or taken is None:
        lacks = "points.exr: it has no depth" if points is None else "camera.json"
        raise InputError(f"the measurement has no {lacks}; measure the photographs again")
    normals = np.asarray(source.normals, np.float64)
    known = (labels >= 0) & (np.linalg.norm(normals, axis=2) > 0.5) & np.isfinite(points).all(axis=2)
    known &= np.linalg.norm(points, axis=2) > 0.0
    if not known.any():
        raise InputError("the measurement knows no pixel of its object: measure it again")
    only = lambda one: np.where(known if one.ndim == 2 else known[..., None], one, 0.0).astype(np.float64)  # noqa: E731
    body, body_error = None if measurement.body is None else measurement.body.value, None
    if fine is not None:
        body = fine.body
    elif measurement.body is not None and measurement.body.error is not None:
        body_error = only(np.nan_to_num(measurement.body.error))
    variance = measurement.normal_variance if fine is None else fine.variance
    own = None if variance is None else only(np.where(np.isfinite(variance), variance, UNKNOWN_DIRECTION))
    shared = measurement.shared_errors
    if own is not None and shared is not None:
        shared = shared.of_size(known.shape)
        own = np.maximum(own - only(shared.variances[0]), 0.0)
    summed, sums = own, measurement.summed_variance if fine is None else fine.summed
    if own is not None and sums is not None:
        summed = np.maximum(own, only(np.minimum(sums, UNKNOWN_DIRECTION)))
    return SeenSurface(
        taken.camera,
        known,
        only(points),
        only(normals),
        None if body is None else only(np.nan_to_num(body)),
        body_error,
        own,
        summed,
        None if own is None else shared,
        has_scale(measurement, taken),
    ).sharpened()
