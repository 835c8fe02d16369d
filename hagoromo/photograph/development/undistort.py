"""Undistort: resample a developed photograph as a pinhole camera of the same matrix would have taken it."""

from __future__ import annotations

from dataclasses import replace

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
