"""Horizon: how high the surface around each pixel stands, and lamps over it, as seen from that pixel.

Enters: points of a surface that one camera saw, and directions. Leaves: angles; that of a lamp is below 0 in shadow.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import Float, arrays, column
from hagoromo.camera.camera import Camera
from hagoromo.measurement.normals.views import Array

NEAR_PX = 40  # [px] in steps of one pixel; beyond, steps grow by GROWTH
GROWTH = 1.05
LEAST_LATERAL = 1e-6  # part of a direction across the line of sight below which a lamp stands behind the eye
LEAST_KNOWN = 0.5  # weight of known pixels around a sample, at least
BELOW = -1.0  # cosine of the angle between horizon and eye where nothing stands


def height_over_horizon(
    points: NDArray[np.floating],
    camera: Camera,
    pixels: tuple[NDArray[np.intp], NDArray[np.intp]],
    to_lamp: Array,
    shaded: NDArray[np.floating] | None = None,
) -> Array:
    """(P,) [rad] of the lamp over the horizon, π where nothing stands towards it.

    Both are angles from the line of sight, in the plane of lamp and eye: h = min over the path of ∠(S − X, eye) −
    ∠(lamp, eye), with S the surface along the path of the light in the picture. points: (h, w, 3) [m], world, 0 where
    unknown. pixels: rows and columns (P,). to_lamp: (P, 3) unit, world. What is hidden from the camera has no shadow.
    shaded: (P, 3) [m], world, X in place of the points of the pixels, on their lines of sight.
    """
    relief = SeenRelief(points, camera, pixels, shaded)
    lamp, here = to_lamp @ camera.world_to_camera[:3, :3].T, relief.here
    eye = -here / np.linalg.norm(here, axis=1, keepdims=True)
    across = np.array(camera.focal) * (lamp[:, :2] * here[:, 2:] - lamp[:, 2:] * here[:, :2])
    lateral = np.linalg.norm(across, axis=1)
    aside = np.sqrt(np.maximum(1.0 - np.einsum("pi,pi->p", lamp, eye) ** 2, 0.0)) > LEAST_LATERAL
    step = np.where(aside[:, None], across / np.maximum(lateral, 1e-300)[:, None], 0.0)
    highest = relief.highest(step)
    of_lamp = np.arccos(np.clip(np.einsum("pi,pi->p", lamp, eye), -1.0, 1.0))
    return np.where(aside & (highest > BELOW), np.arccos(np.clip(highest, -1.0, 1.0)) - of_lamp, np.pi)


class SeenRelief:
    """The depth of each pixel of a surface, along which paths in the picture are walked from some of its pixels."""

    def __init__(
        self,
        points: NDArray[np.floating],
        camera: Camera,
        pixels: tuple[NDArray[np.intp], NDArray[np.intp]],
        shaded: NDArray[np.floating] | None = None,
    ) -> None:
        """Arguments: see `height_over_horizon`."""
        jit, pose, known = arrays(), camera.world_to_camera[:3], np.linalg.norm(points, axis=2) > 0.0
        depth = points @ pose[2, :3] + pose[2, 3]
        middle = float(np.median(depth[known])) if known.any() else 1.0
        self.camera, self.size = camera, known.shape
        here = points[pixels] if shaded is None else shaded
        self.here = here.astype(np.float64) @ pose[:, :3].T + pose[:, 3]  # (P, 3) [m], the camera's axes
        # offsets from the middle, so that single precision holds differences between neighbours
        self._offset = column(jit.Float, np.where(known, depth - middle, 0.0).ravel().astype(np.float32))
        self._known = column(jit.Float, known.ravel().astype(np.float32))
        self._own = column(jit.Float, (self.here[:, 2] - middle).astype(np.float32))
        self._row, self._column = (column(jit.Float, one.astype(np.float32)) for one in pixels)
        self._middle = dr.opaque(jit.Float, middle)
        along = strides(float(np.hypot(*np.ptp(np.argwhere(known), axis=0))) if known.any() else 1.0)
        self._strides, self._count = column(jit.Float, along.astype(np.float32)), dr.opaque(jit.UInt, len(along))

    def highest(self, step: Array) -> Array:
        """(P,) cosine of the angle between eye and horizon, BELOW where nothing stands.

        step: (P, 2) direction of the path from each pixel in the picture, x and y, of length 1 or 0.
        """
        jit = arrays()
        across, down = (column(jit.Float, one.astype(np.float32)) for one in step.T)
        (fx, fy), (cx, cy) = ((dr.opaque(jit.Float, float(one)) for one in pair) for pair in self._lens())
        x, y = (self._column + 0.5 - cx) / fx, (self._row + 0.5 - cy) / fy
        to_eye = dr.normalize(jit.Array3f(-x, -y, -1.0))

        def walked(k: Any, best: Float) -> tuple[Any, Float]:
            far = dr.gather(jit.Float, self._strides, k)
            right, under = far * across, far * down
            offset, weight = self._between(self._row + under, self._column + right)
            rise = offset - self._own
            depth = self._middle + offset
            away = jit.Array3f(depth * right / fx + rise * x, depth * under / fy + rise * y, rise)
            cosine = dr.dot(away, to_eye) / dr.fmax(dr.norm(away), 1e-30)
            return k + 1, dr.select((weight > LEAST_KNOWN) & (cosine > best), cosine, best)

        start = dr.zeros(jit.UInt, len(step)), dr.full(jit.Float, BELOW, len(step))
        _, best = dr.while_loop(start, lambda k, _: k < self._count, walked)
        return np.asarray(best.numpy(), np.float64)

    def _lens(self) -> tuple[tuple[float, float], tuple[float, float]]:
        return self.camera.focal, self.camera.principal

    def _between(self, row: Float, across: Float) -> tuple[Float, Float]:
        """Offset of the depth between known pixels, and the weight of those around."""
        jit, (height, width) = arrays(), self.size
        top, left = dr.floor(row), dr.floor(across)
        total, weight = dr.zeros(jit.Float), dr.zeros(jit.Float)
        for below in (0, 1):
            for right in (0, 1):
                r, c = jit.Int(top) + below, jit.Int(left) + right
                inside = (r >= 0) & (c >= 0) & (r < height) & (c < width)
                index = jit.UInt(dr.select(inside, r * width + c, 0))
                share = (1.0 - dr.abs(row - (top + below))) * (1.0 - dr.abs(across - (left + right)))
                share = share * dr.gather(jit.Float, self._known, index, inside)
                total += share * dr.gather(jit.Float, self._offset, index, inside)
                weight += share
        return total / dr.fmax(weight, 1e-9), weight


def strides(reach: float) -> Array:
    """Distances [px] of the samples along a path: 1, 2, … NEAR_PX, then growing steps up to `reach`."""
    near = np.arange(1.0, min(NEAR_PX, max(reach, 1.0)) + 1.0)
    if reach <= NEAR_PX:
        return near
    count = int(np.ceil(np.log(reach / NEAR_PX) / np.log(GROWTH)))
    return np.concatenate([near, NEAR_PX * GROWTH ** np.arange(1, count + 1)])
