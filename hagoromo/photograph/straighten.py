"""Straighten: photographs of one camera resampled without its lens distortion, line by line as OpenCV does it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.camera import Camera

LEAST_VALID_SHARE = 0.999  # least weight of valid samples in a valid resampled pixel


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
