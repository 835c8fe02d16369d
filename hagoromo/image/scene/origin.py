"""Origin: the place in the world from which kernels count the coordinates of a scene.

Kernels compute in single precision, whose numbers lie 6e-8 of their own size apart: 1 mm at 10 km. So a scene is moved
in double precision, to where the matter that its camera sees stands about (0, 0, 0). The picture is the same wherever
the scene stands in the world. The origin does not depend on the lamps, and on the camera only in scenes of more than
STEP voxels across: what a preview keeps on the device stays there while the camera moves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.camera import Camera
from hagoromo.camera.pose import pose_of
from hagoromo.image.scene.scene import Scene
from hagoromo.image.scene.surface import Surface
from hagoromo.volume.box import VolumeBox

STEP = 2.0**13  # [voxel] in which the origin follows the camera: near it, places are then exact to 2e-4 voxel
NEAR = 2.0  # sizes of the matter, up to which it stands near the origin of the world as it is
FAR = 16.0  # sizes of all matter, from which on the rays of a camera begin in front of it
Origin = NDArray[np.float64]


def origin_of(things: Sequence[VolumeBox] | Sequence[Surface], camera: Camera) -> Origin:
    """(3,) [m], world: the middle of `things`, moved towards the camera by whole steps within their bounds.

    (0, 0, 0) in place of a middle less than NEAR sizes away: pictures of such scenes keep their bits.
    """
    corners = np.concatenate([thing.corners() for thing in things])
    low, high = corners.min(axis=0), corners.max(axis=0)
    step, middle = STEP * min(thing.finest for thing in things), 0.5 * (low + high)
    if np.linalg.norm(middle) <= NEAR * np.linalg.norm(high - low):
        middle = np.zeros(3)
    return middle + step * np.round((np.clip(camera.position, low, high) - middle) / step)


def scene_origin(scene: Scene) -> Origin:
    """(3,) [m], world: the origin of a scene, by its boxes; by its surfaces where there is no box."""
    return origin_of(scene.boxes or scene.surfaces, scene.camera)


def scene_from(scene: Scene, origin: Origin) -> Scene:
    """The scene with all its places counted from `origin` (3,) [m]."""
    return replace(
        scene,
        camera=camera_from(scene.camera, origin),
        lamps=tuple(lamp.moved(-origin) for lamp in scene.lamps),
        area_lamps=tuple(lamp.moved(-origin) for lamp in scene.area_lamps),
        boxes=tuple(box.with_pose(_pose(box.pose, origin)) for box in scene.boxes),
        surfaces=tuple(replace(surface, pose=_pose(surface.pose, origin)) for surface in scene.surfaces),
        moving=scene.moving and scene.moving.moved(-origin),
    )


def camera_from(camera: Camera, origin: Origin) -> Camera:
    """The camera with its place counted from `origin` (3,) [m]."""
    rotation = camera.world_to_camera[:3, :3]
    return camera.with_pose(pose_of(rotation, camera.world_to_camera[:3, 3] + rotation @ origin))


def depth_of_matter(scene: Scene) -> float:
    """Depth in front of the camera [m] from which on there is matter, or a lamp that is seen; 0 for a camera less than
    FAR sizes of them away.
    """
    lights = [light.corners() for light in scene.wide_lights if light.visible]
    corners = np.concatenate([*lights, *(thing.corners() for thing in (*scene.boxes, *scene.surfaces))])
    depth = corners @ scene.camera.world_to_camera[2, :3] + scene.camera.world_to_camera[2, 3]
    nearest, size = float(depth.min()), float(np.linalg.norm(np.ptp(corners, axis=0)))
    if scene.moving is not None:
        nearest = scene.moving.depth_of(scene.boxes, scene.surfaces, np.concatenate([np.zeros((0, 3)), *lights]))
    return nearest if nearest > FAR * size else 0.0


def _pose(pose: NDArray[np.float64], origin: Origin) -> NDArray[np.float64]:
    return pose_of(pose[:3, :3], pose[:3, 3] - origin)
