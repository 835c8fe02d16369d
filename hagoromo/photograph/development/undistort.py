"""Undistort: photographs resampled as a pinhole camera of the same matrix would have taken them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError
from hagoromo.photograph.development.development import Development

LEAST_VALID_SHARE = 0.999  # least weight of valid samples in a valid resampled pixel


def undistorted(development: Development, camera: Camera) -> Development:
    """`development`, taken by `camera`, resampled bilinearly; pixels outside the photograph are invalid.

    The variance is the mean of the neighbours' variances, an upper bound. With a mosaic, a pixel is native if the
    nearest sample was. `InputError` if the sizes differ.
    """
    import cv2

    if development.valid.shape != (camera.height, camera.width):
        height, width = development.valid.shape
        raise InputError(
            f"the photograph is {width} × {height} px and the camera {camera.width} × {camera.height}: give its camera"
        )
    pinhole = replace(camera, distortion=(0.0,) * len(camera.distortion))
    forward = pinhole.position + pinhole.pixel_directions()
    pixels = (camera.project(forward) - 0.5).astype(np.float32)  # OpenCV counts from the centre of the first pixel
    x, y = np.ascontiguousarray(np.nan_to_num(pixels[..., 0], nan=-1e4)), np.ascontiguousarray(pixels[..., 1])

    def resampled(values: NDArray, how: int) -> NDArray[np.float32]:
        return np.asarray(cv2.remap(values.astype(np.float32), x, y, how, borderValue=0.0), np.float32)

    each = development.valid_channels
    each = np.repeat(development.valid[..., None], development.values.shape[2], axis=2) if each is None else each
    shares = np.where(each, 1.0, 0.0).astype(np.float32)
    values, variance = (
        resampled(part * shares, cv2.INTER_LINEAR) for part in (development.values, development.variance)
    )
    fine = np.asarray(resampled(shares, cv2.INTER_LINEAR).reshape(each.shape) > LEAST_VALID_SHARE, np.bool_)
    native = None if development.native is None else resampled(development.native, cv2.INTER_NEAREST) > 0.5
    return replace(
        development,
        values=values.reshape(development.values.shape),
        variance=variance.reshape(development.variance.shape),
        valid=np.all(fine, axis=2),
        valid_channels=fine,
        native=None if native is None else native.reshape(development.values.shape),
        undistorted=True,
    )


@dataclass(frozen=True, eq=False)
class Straightener:
    """Where each pixel of the pinhole is in the photograph: x, y (height, width) [px] from the first centre."""

    x: NDArray[np.float32]
    y: NDArray[np.float32]

    @staticmethod
    def of(camera: Camera) -> Straightener:
        """Of the photographs of `camera`."""
        import cv2

        (ax, ay), (x0, y0) = camera.focal, camera.principal
        matrix = np.array([[ax, 0.0, x0 - 0.5], [0.0, ay, y0 - 0.5], [0.0, 0.0, 1.0]])
        size = camera.width, camera.height
        x, y = cv2.initUndistortRectifyMap(matrix, np.array(camera.distortion), None, matrix, size, cv2.CV_32FC1)  # type: ignore[call-overload]
        return Straightener(np.asarray(x, np.float32), np.asarray(y, np.float32))

    def values(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """Values (height, width, C), bilinear; 0 outside the photograph."""
        import cv2

        moved = cv2.remap(values, self.x, self.y, cv2.INTER_LINEAR, borderValue=0.0)
        return np.asarray(moved, np.float32).reshape(values.shape)

    def valid(self, valid: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """(height, width) true where all samples that count are valid and inside the photograph."""
        import cv2

        share = cv2.remap(valid.astype(np.float32), self.x, self.y, cv2.INTER_LINEAR, borderValue=0.0)
        return np.asarray(share) > LEAST_VALID_SHARE

    def native(self, native: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """(height, width, C) whether the nearest sample was measured, not interpolated."""
        import cv2

        nearest = cv2.remap(native.astype(np.uint8), self.x, self.y, cv2.INTER_NEAREST, borderValue=0.0)
        return np.asarray(nearest).reshape(native.shape) > 0
