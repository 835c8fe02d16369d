"""Box camera: a square picture of volume boxes from the front and a little from above, and a key lamp for it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.camera import Camera
from hagoromo.volume.box import VolumeBox

FIELD = 1.06  # of view, sizes of the matter
AWAY, TOWARDS = 8.0, (0.25, -1.0, 0.3)  # sizes of the matter from it to the camera, and its direction
TO_KEY = (-0.5, -1.0, 1.0)  # direction to a far lamp


def box_camera(box: VolumeBox, pixels: int) -> Camera:
    """A square picture of the matter of `box`, seen from the front and a little from above."""
    return camera_of_corners([brick_corners(box)], pixels)


def camera_of_corners(corners: Sequence[NDArray[np.float64]], pixels: int, across: float | None = None) -> Camera:
    """The same of several boxes, each by its `brick_corners` [m]. across: width of the picture [m], in their middle;
    None: all of them is seen.
    """
    sizes = [float(np.linalg.norm(one[-1] - one[0])) for one in corners]
    points, middle = np.concatenate(corners), _middle(corners)
    away = AWAY * max(sizes)
    straight = Camera(pixels, pixels, (1.0, 1.0), (0.5 * pixels, 0.5 * pixels))
    straight = straight.look_at(middle + away * np.asarray(TOWARDS) / np.linalg.norm(TOWARDS), middle)
    aside = (points - middle) @ straight.world_to_camera[:2, :3].T
    focal = pixels * away / (FIELD * 2.0 * float(np.abs(aside).max()) if across is None else across)
    return replace(straight, focal=(focal, focal))


def width_in_middle(corners: Sequence[NDArray[np.float64]], camera: Camera) -> float:
    """Width of the picture of such a camera, where the middle of the boxes is [m]."""
    return camera.width / camera.focal[0] * float(np.linalg.norm(camera.position - _middle(corners)))


def brick_corners(box: VolumeBox) -> NDArray[np.float64]:
    """The eight corners (8, 3), world [m], of what the bricks of a box hold."""
    low, high = ((bound + 0.5) * box.voxel_size for bound in box.bricks.bounds)
    unit = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    return (low + unit * (high - low)) @ box.pose[:3, :3].T + box.pose[:3, 3]


def _middle(corners: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
    points = np.concatenate(corners)
    return 0.5 * (points.min(axis=0) + points.max(axis=0))
