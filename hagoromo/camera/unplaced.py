"""Unplaced camera: one whose distance from the object nobody has measured, with the object at the world's origin.

World axes: x right, y up, z from the object to the camera, those of lamps that were calibrated without a camera. The
unit of length is the longer side of the picture at the object, because nothing tells the object's size.
"""

from __future__ import annotations

import numpy as np

from hagoromo.camera.camera import Camera

# Focal length over the longer side of the pinhole that stands for an orthographic view: its rays differ by 0.04° at a
# corner. Single precision, in which pictures and maps of points are, still has 1/16,000 of a side there.
ORTHOGRAPHIC_FOCAL = 1000.0
UP_AND_BACK = np.diag([1.0, -1.0, -1.0, 1.0])  # world axes x right, y up, z to the camera → the camera's


def unplaced_camera(width: int, height: int, focal_px: float | None) -> Camera:
    """The camera of `width` × `height` px; focal_px: None for an orthographic view, which a far pinhole stands for.

    >>> camera = unplaced_camera(30, 20, None)
    >>> camera.position.tolist(), camera.project([0.5, 0.0, 0.0]).tolist()  # the right edge of the picture
    ([0.0, 0.0, 1000.0], [30.0, 10.0])
    """
    longer = max(width, height)
    focal = ORTHOGRAPHIC_FOCAL * longer if focal_px is None else focal_px
    pose = UP_AND_BACK.copy()
    pose[2, 3] = focal / longer
    name = "orthographic" if focal_px is None else ""
    camera = Camera(width, height, (focal, focal), (width / 2, height / 2), name=name, orthographic=focal_px is None)
    return camera.with_pose(pose)


def is_unplaced(camera: Camera) -> bool:
    """Whether `camera` stands where `unplaced_camera` puts one: its lengths are no metres.

    >>> is_unplaced(unplaced_camera(30, 20, 45.0)), is_unplaced(Camera(30, 20, (45.0, 45.0), (15.0, 10.0)))
    (True, False)
    """
    expected = unplaced_camera(camera.width, camera.height, camera.focal[0])
    return bool(np.allclose(camera.world_to_camera, expected.world_to_camera, rtol=1e-9, atol=1e-12))
