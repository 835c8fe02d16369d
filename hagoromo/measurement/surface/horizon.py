"""Horizon: how high lamps stand over the surface around each pixel, as seen from that pixel.

Enters: points of a surface that one camera saw, and directions to a lamp. Leaves: an angle, below 0 in cast shadow.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.camera import Camera
from hagoromo.measurement.normals.views import Array

NEAR_PX = 40  # [px] in steps of one pixel; beyond, steps grow by GROWTH
GROWTH = 1.05
LEAST_LATERAL = 1e-6  # part of a direction across the line of sight below which a lamp stands behind the eye
LEAST_KNOWN = 0.5  # weight of known pixels around a sample, at least


def height_over_horizon(
    points: NDArray[np.floating], camera: Camera, pixels: tuple[NDArray[np.intp], NDArray[np.intp]], to_lamp: Array
) -> Array:
    """(P,) [rad] of the lamp over the horizon, π where nothing stands towards it.

    Both are angles from the line of sight, in the plane of lamp and eye: h = min over the path of ∠(S − X, eye) −
    ∠(lamp, eye), with S the surface along the path of the light in the picture. points: (h, w, 3) [m], world, 0 where
    unknown. pixels: rows and columns (P,). to_lamp: (P, 3) unit, world. What is hidden from the camera has no shadow.
    """
    pose, known = camera.world_to_camera[:3], np.linalg.norm(points, axis=2) > 0.0
    depth = np.where(known, points @ pose[2, :3] + pose[2, 3], 0.0)
    here = points[pixels].astype(np.float64) @ pose[:, :3].T + pose[:, 3]
    lamp = to_lamp @ pose[:, :3].T
    eye = -here / np.linalg.norm(here, axis=1, keepdims=True)
    across = np.array(camera.focal) * (lamp[:, :2] * here[:, 2:] - lamp[:, 2:] * here[:, :2])
    lateral = np.linalg.norm(across, axis=1)
    aside = np.sqrt(np.maximum(1.0 - np.einsum("pi,pi->p", lamp, eye) ** 2, 0.0)) > LEAST_LATERAL
    step = np.where(aside[:, None], across / np.maximum(lateral, 1e-300)[:, None], 0.0)
    highest = np.full(len(here), -1.0)  # cosine of the angle between horizon and eye
    for walked in _strides(float(np.hypot(*np.ptp(np.argwhere(known), axis=0)))):
        column, row = pixels[1] + walked * step[:, 0], pixels[0] + walked * step[:, 1]
        there, sure = _between(depth, known, row, column)
        x = (column + 0.5 - camera.principal[0]) / camera.focal[0]
        y = (row + 0.5 - camera.principal[1]) / camera.focal[1]
        away = np.stack([x, y, np.ones_like(x)], axis=1) * there[:, None] - here
        cosine = np.einsum("pi,pi->p", away, eye) / np.maximum(np.linalg.norm(away, axis=1), 1e-300)
        highest = np.where(sure & (cosine > highest), cosine, highest)
    of_lamp = np.arccos(np.clip(np.einsum("pi,pi->p", lamp, eye), -1.0, 1.0))
    return np.where(aside & (highest > -1.0), np.arccos(np.clip(highest, -1.0, 1.0)) - of_lamp, np.pi)


def _between(depth: Array, known: NDArray[np.bool_], row: Array, column: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Depth between known pixels, and whether enough of them are around."""
    from scipy.ndimage import map_coordinates

    place = np.stack([row, column])
    weight = map_coordinates(known.astype(np.float64), place, order=1, mode="constant", cval=0.0)
    total = map_coordinates(depth, place, order=1, mode="constant", cval=0.0)
    return total / np.maximum(weight, 1e-9), weight > LEAST_KNOWN


def _strides(reach: float) -> Array:
    """Distances [px] of the samples along a path: 1, 2, … NEAR_PX, then growing steps up to `reach`."""
    near = np.arange(1.0, min(NEAR_PX, max(reach, 1.0)) + 1.0)
    if reach <= NEAR_PX:
        return near
    count = int(np.ceil(np.log(reach / NEAR_PX) / np.log(GROWTH)))
    return np.concatenate([near, NEAR_PX * GROWTH ** np.arange(1, count + 1)])
