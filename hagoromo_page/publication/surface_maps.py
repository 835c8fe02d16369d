"""Surface maps: what a page shows of a measured object, in the axes of its camera.

The page's axes are x right, y up, z to the eye. Enters: a Measurement and the camera that saw the object.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError
from hagoromo.measurement.measurement import Measurement
from hagoromo.measurement.nearest import nearest_known
from hagoromo.reflectance.material.material_estimate import MaterialEstimate
from hagoromo_page.publication.closely import CloseLook

FLIP = np.diag([1.0, -1.0, -1.0])  # OpenCV's camera axes ↔ the page's
MAPS = ("labels", "normals", "body", "depth", "beta", "gamma", "tail", "normal_error", "body_error", "gloss_error",
        "curvature", "occlusion", "width")  # fmt: skip
MARGIN_PX = 2  # px around the object
LEAST_KNOWN = np.pi / 2  # rad: a larger error of a direction says no more than that nothing is known of it
Map = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SurfaceMaps:
    """Maps (h, w) of the object that `camera` sees.

    labels: index into materials, −1 unknown. normals: (h, w, 3) unit, page's axes. body: (h, w, C) α c_b [1/sr].
    depth: distance along the optical axis [m]. beta [1/sr], gamma [rad], tail 1/ν: where gloss is known per pixel, and
    the tail where it varies. normal_error: standard deviation of the normal's direction, ≤ π/2 [rad]. body_error:
    relative standard error of the body colour. gloss_error: relative standard error of γ. Each of these is None where
    it is not known, and 0 at unknown pixels. curvature [1/unit], occlusion: see `CloseLook`; NaN at unknown pixels.
    width [m]: see `CloseLook`; None where it is not known. has_scale: whether metres are metres. x, y: place of the
    first pixel in the photograph [px].
    """

    name: str
    materials: tuple[MaterialEstimate, ...]
    camera: Camera
    labels: NDArray[np.int64]
    normals: Map
    body: Map
    depth: Map | None
    beta: Map | None
    gamma: Map | None
    tail: Map | None
    normal_error: Map | None
    body_error: Map | None
    gloss_error: Map | None
    curvature: Map | None = field(default=None, kw_only=True)
    occlusion: Map | None = field(default=None, kw_only=True)
    width: Map | None = field(default=None, kw_only=True)
    has_scale: bool
    x: float = 0.0
    y: float = 0.0

    @property
    def known(self) -> NDArray[np.bool_]:
        """(h, w) pixels of the object."""
        return self.labels >= 0

    def cropped(self) -> SurfaceMaps:
        """Only the rectangle around the object."""
        rows, columns = np.flatnonzero(self.known.any(axis=1)), np.flatnonzero(self.known.any(axis=0))
        top, left = max(rows[0] - MARGIN_PX, 0), max(columns[0] - MARGIN_PX, 0)
        return self.part(slice(top, rows[-1] + 1 + MARGIN_PX), slice(left, columns[-1] + 1 + MARGIN_PX))

    def part(self, rows: slice, columns: slice) -> SurfaceMaps:
        """Only the pixels in `rows` and `columns`."""
        return self._mapped(lambda one: one[rows, columns], (1.0, 1.0), float(columns.start), float(rows.start))

    def reduced(self, factor: float) -> SurfaceMaps:
        """With pixels `factor` times as wide: means over the object's part of each, the label of most of them."""
        import cv2

        height, width = self.labels.shape
        size = max(round(width / factor), 1), max(round(height / factor), 1)
        cover = cv2.resize(self.known.astype(np.float64), size, interpolation=cv2.INTER_AREA)
        labels = cv2.resize(self.labels.astype(np.int16), size, interpolation=cv2.INTER_NEAREST).astype(np.int64)
        shares = [
            cv2.resize((self.labels == k).astype(np.float64), size, interpolation=cv2.INTER_AREA)
            for k in range(len(self.materials))
        ]
        labels = np.where(cover >= 0.5, np.argmax(shares, axis=0), -1).astype(np.int64) if shares else labels

        def mean(one: Map) -> Map:
            inside = self.known if one.ndim == 2 else self.known[..., None]
            small = cv2.resize(np.where(inside, one, 0.0), size, interpolation=cv2.INTER_AREA)
            small = small.reshape(*cover.shape, *one.shape[2:])
            return small / np.maximum(cover if one.ndim == 2 else cover[..., None], 1e-9)

        small = self._mapped(
            lambda one: labels if one is self.labels else mean(one), (width / size[0], height / size[1]), 0.0, 0.0
        )
        length = np.linalg.norm(small.normals, axis=2, keepdims=True)
        labels = np.where(length[..., 0] > 1e-6, labels, -1)
        return replace(small, labels=labels, normals=small.normals / np.maximum(length, 1e-6))

    def _mapped(
        self, change: Callable[[Any], Any], factor: tuple[float, float], left: float, top: float
    ) -> SurfaceMaps:
        """Every map changed alike, and the camera with it; factor: of the width and height of a pixel."""
        maps = {name: None if getattr(self, name) is None else change(getattr(self, name)) for name in MAPS}
        height, width = np.asarray(maps["labels"]).shape
        camera = self.camera.resampled(width, height, factor, (left, top))
        return replace(self, **maps, camera=camera, x=self.x + left, y=self.y + top)


def surface_maps(
    measurement: Measurement, camera: Camera, name: str, has_scale: bool, look: CloseLook | None = None
) -> SurfaceMaps:
    """The maps of `measurement`, whose photographs `camera` took; cropped to the object.

    `InputError` where the sizes differ, or no pixel of the object is known.
    """
    fine = measurement.fine
    source = measurement if fine is None else fine
    labels = np.asarray(source.labels, np.int64)
    normals = np.asarray(source.normals, np.float64) @ camera.world_to_camera[:3, :3].T @ FLIP
    if labels.shape != (camera.height, camera.width):
        raise InputError(
            f"the measurement is {labels.shape[1]} × {labels.shape[0]} px and its camera takes {camera.width} × "
            f"{camera.height}: give the capture that was measured"
        )
    labels = np.where(np.linalg.norm(normals, axis=2) > 0.5, labels, -1)
    if not (labels >= 0).any():
        raise InputError("the measurement knows no pixel of the object: there is nothing to publish")
    gloss = None if fine is not None else measurement.gloss
    variance = measurement.normal_variance if fine is None else fine.variance
    errors = None if fine is not None or measurement.body is None else measurement.body.error
    body = _body(measurement, labels)
    filled = lambda key: (  # noqa: E731
        None if gloss is None else _filled(getattr(gloss, key), measurement.materials, labels, key)
    )
    return SurfaceMaps(
        name=name,
        materials=measurement.materials,
        camera=camera,
        labels=labels,
        normals=normals,
        body=body,
        depth=_depth(source.points if look is None else look.points, camera, labels),
        beta=filled("beta"),
        gamma=filled("gamma"),
        tail=None if gloss is None else _tail(gloss.nu, measurement.materials, labels),
        normal_error=None if variance is None else np.where(labels >= 0, _angle_error(variance), 0.0),
        body_error=None if errors is None else _relative(errors, body),
        gloss_error=None if gloss is None else np.nan_to_num(gloss.gamma_error / gloss.gamma),
        has_scale=has_scale,
        curvature=None if look is None else look.curvature,
        occlusion=None if look is None else look.occlusion,
        width=None if look is None else look.width,
    ).cropped()


def _body(measurement: Measurement, labels: NDArray[np.int64]) -> Map:
    """α c_b of every pixel; that of its material where the pixel's own is not known."""
    colours = np.array([one.alpha * np.array(one.body_colour) for one in measurement.materials])
    mean = np.where((labels >= 0)[..., None], colours[np.maximum(labels, 0)], 0.0)
    if measurement.fine is None and measurement.body is None:
        return mean
    value: Any = measurement.fine.body if measurement.fine is not None else getattr(measurement.body, "value")  # noqa: B009
    known = np.isfinite(value).all(axis=2, keepdims=True) & (np.asarray(value) != 0.0).any(axis=2, keepdims=True)
    return np.where(known, np.nan_to_num(value), mean).astype(np.float64)


def _filled(values: Map, materials: Sequence[MaterialEstimate], labels: NDArray[np.int64], key: str) -> Map:
    """β or γ of every pixel; that of its material where the pixel's own is not known."""
    means = np.array([getattr(one, key) for one in materials])[np.maximum(labels, 0)]
    return np.where(np.isfinite(values) & (values > 0.0), np.nan_to_num(values), means)


def _tail(nu: Map | None, materials: Sequence[MaterialEstimate], labels: NDArray[np.int64]) -> Map | None:
    """1/ν of every pixel, 0 for Gaussian facets; None where the pixels of each material are alike."""
    of_material = np.array([1.0 / one.nu for one in materials])[np.maximum(labels, 0)]
    if nu is None:
        return None
    tail = np.where((labels >= 0) & np.isfinite(1.0 / nu), 1.0 / nu, of_material)
    return None if np.allclose(tail, of_material, rtol=1e-5, atol=0.0) else tail


def _depth(points: NDArray[np.floating] | None, camera: Camera, labels: NDArray[np.int64]) -> Map | None:
    """Distance along the optical axis [m]; that of the nearest known pixel where it is unknown."""
    if points is None:
        return None
    pose = camera.world_to_camera
    depth = points.astype(np.float64) @ pose[2, :3] + pose[2, 3]
    known = (np.linalg.norm(points, axis=2) > 0) & np.isfinite(depth) & (labels >= 0) & (depth > 0.0)
    if not known.any():
        return None
    return depth[nearest_known(known)]


def _angle_error(variance: NDArray[np.floating]) -> Map:
    """Standard error of a direction [rad]; LEAST_KNOWN where it is larger, or not a number."""
    largest = LEAST_KNOWN**2
    return np.sqrt(np.clip(np.where(np.isfinite(variance), variance, largest), 0.0, largest).astype(np.float64))


def _relative(error: Map, body: Map) -> Map:
    """Relative standard error of the mean channel."""
    mean = np.maximum(body.mean(axis=2), 1e-9)
    return np.nan_to_num(np.where(np.isfinite(error), error, 0.0).mean(axis=2) / mean)
