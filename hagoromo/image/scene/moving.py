"""Moving: where the camera, boxes and surfaces of a scene are while the shutter is open.

Instants are spread evenly over that time; walks of mode path draw one each, and have all things as they are at it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import Float, UInt, arrays, lookup
from hagoromo.camera.camera import Axes, Camera
from hagoromo.errors import InputError
from hagoromo.image.scene.surface import Surface
from hagoromo.transport.frames import Poses
from hagoromo.volume.box import VolumeBox

INSTANTS = 512  # an edge that moves by so many pixels is smooth to a pixel


@dataclass(frozen=True, eq=False)
class MovingScene:
    """cameras: world_to_camera (instants, 4, 4). boxes: poses (instants, boxes, 4, 4), in the order of the scene's.

    surfaces: of those that move, by their numbers, poses (instants, 4, 4), which differ by turns and shifts alone.
    """

    cameras: Poses
    boxes: Poses
    surfaces: Mapping[int, Poses] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if any(poses.shape != (len(self.cameras), 4, 4) for poses in self.surfaces.values()):
            raise InputError("poses of surfaces at instants: give (instants, 4, 4) of each, as many as of the camera")
        if self.cameras.ndim != 3 or self.boxes.ndim != 4 or len(self.cameras) != len(self.boxes):
            raise InputError(
                f"poses at instants are {self.cameras.shape} of the camera and {self.boxes.shape} of boxes: give "
                f"(instants, 4, 4) and (instants, boxes, 4, 4)"
            )

    def record(self) -> dict[str, Any]:
        """What metadata say of it."""
        return {"instants": len(self.cameras)} | ({"surfaces": sorted(self.surfaces)} if self.surfaces else {})

    def seen_by(self, camera: Camera) -> MovingScene:
        """The same motion of boxes and surfaces before a camera that stands still."""
        return replace(self, cameras=np.repeat(camera.world_to_camera[None], len(self.cameras), axis=0))

    def moved(self, shift: NDArray[np.float64]) -> MovingScene:
        """The same motion with all places shifted, (3,) [m]."""
        cameras, boxes = self.cameras.copy(), self.boxes.copy()
        surfaces = {number: poses.copy() for number, poses in self.surfaces.items()}
        cameras[:, :3, 3] -= self.cameras[:, :3, :3] @ shift
        for poses in (boxes, *surfaces.values()):
            poses[..., :3, 3] += shift
        return MovingScene(cameras, boxes, surfaces)

    def depth_of(self, boxes: Sequence[VolumeBox], surfaces: Sequence[Surface], corners: NDArray[np.float64]) -> float:
        """Least depth before the camera of the boxes, the surfaces, and of `corners` (n, 3) of lights, ever [m]."""
        still = [surface.corners() for number, surface in enumerate(surfaces) if number not in self.surfaces]
        corners = np.concatenate([corners.reshape(-1, 3), *still])
        moving = [surfaces[number] for number in self.surfaces]
        depth, own = np.inf, [(one.corners(), np.linalg.inv(one.pose)) for one in (*boxes, *moving)]
        for k, camera in enumerate(self.cameras):
            poses = [*self.boxes[k], *(poses[k] for poses in self.surfaces.values())]
            ways = [pose @ back for (_, back), pose in zip(own, poses, strict=True)]
            moved = [one @ way[:3, :3].T + way[:3, 3] for (one, _), way in zip(own, ways, strict=True)]
            every = np.concatenate([corners, *moved])
            depth = min(depth, float((every @ camera[2, :3] + camera[2, 3]).min()))
        return depth


class MovingCamera:
    """The axes of a camera at its instants, on the device."""

    def __init__(self, moving: MovingScene, ahead: float) -> None:
        """ahead: depth at which rays begin, see `Camera.rays` [m]."""
        cameras = moving.cameras
        places = -np.einsum("nji,nj->ni", cameras[:, :3, :3], cameras[:, :3, 3]) + ahead * cameras[:, 2, :3]
        rows = np.concatenate([cameras[:, :3, :3].reshape(-1, 9), places], axis=1)
        self.rows, self.count = lookup(arrays().Float, rows.astype(np.float32)), len(cameras)

    def axes(self, instant: UInt) -> Axes:
        """Right, down and forward, and where rays begin, of rays at their instants."""
        jit = arrays()
        numbers = [dr.gather(jit.Float, self.rows, instant * 12 + k) for k in range(12)]
        right, down, forward, begin = (jit.Array3f(*numbers[k : k + 3]) for k in range(0, 12, 3))
        return right, down, forward, begin


def instants(sample: UInt, start: Float, count: int) -> UInt:
    """The instant of walks. sample: their number in the pixel. start: a random number of the pixel, in [0, 1).

    Walk s is at the radical inverse of s (van der Corput 1935) behind the start: those of a pixel are spread evenly
    over the time, and each alone is at any instant.
    """
    jit = arrays()
    place = jit.Float(dr.brev(sample) >> 8) * 2.0**-24 + start
    return dr.minimum(jit.UInt((place - dr.floor(place)) * float(count)), count - 1)
