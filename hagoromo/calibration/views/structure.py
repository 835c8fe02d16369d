"""Structure: cameras and points that explain photographs of many views, without a scale of their own.

Residuals are those of our own `Camera.project`, not of the program that found the structure.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.camera import Camera
from hagoromo.camera.pose import pose_of
from hagoromo.errors import InputError

Array = NDArray[np.float64]


class Sightings(NamedTuple):
    """Points that a photograph shows. point: (m,) index into the points. image: (m, 2) (x, y) [px]."""

    point: NDArray[np.int64]
    image: Array


@dataclass(frozen=True, eq=False)
class Structure:
    """Cameras and points of photographs of many views.

    views: name of the photograph → its camera, posed. points: (n, 3) in the unit of the poses. sightings: name → points
    that it shows. left_out: name of a photograph without a camera → why. lens_error: standard errors of what was fitted
    of the lens, by the keys of camera.json, from the spread of the residuals.
    """

    views: Mapping[str, Camera]
    points: Array
    sightings: Mapping[str, Sightings]
    left_out: Mapping[str, str] = field(default_factory=dict)
    lens_error: Mapping[str, float] = field(default_factory=dict)

    def residuals(self, name: str) -> Array:
        """(m, 2) measured minus predicted points of a photograph [px]."""
        seen = self.sightings[name]
        return seen.image - self.views[name].project(self.points[seen.point])

    def rms(self, name: str) -> float:
        """Root mean square length of the residuals of a photograph [px]; 0 where it shows no point."""
        squares = (self.residuals(name) ** 2).sum(axis=1)
        return float(np.sqrt(squares.mean())) if squares.size else 0.0

    @property
    def rms_of_all(self) -> float:
        """Root mean square length of all residuals [px]."""
        squares = np.concatenate([(self.residuals(name) ** 2).sum(axis=1) for name in self.views])
        return float(np.sqrt(squares.mean())) if squares.size else 0.0

    def moved(self, rotation: Array, shift: Array, scale: float = 1.0) -> Structure:
        """The same structure in other world axes: a place x becomes scale · rotation x + shift."""
        views = {}
        for name, camera in self.views.items():
            turned = camera.world_to_camera[:3, :3] @ rotation.T
            views[name] = camera.with_pose(pose_of(turned, scale * camera.world_to_camera[:3, 3] - turned @ shift))
        return replace(self, views=views, points=scale * self.points @ rotation.T + shift)

    def upright(self) -> Structure:
        """With z up, the object at the origin, and the mean distance of the cameras from it as the unit of length.

        Up is the mean of what is up in the photographs. The object is where the optical axes meet. `InputError` where
        they meet nowhere in front of the cameras.
        """
        cameras = list(self.views.values())
        places = np.stack([camera.position for camera in cameras])
        ways = np.stack([camera.world_to_camera[2, :3] for camera in cameras])
        across = np.eye(3) - ways[:, :, None] * ways[:, None, :]
        middle = np.linalg.lstsq(across.sum(axis=0), np.einsum("nij,nj->i", across, places), rcond=None)[0]
        depth = np.einsum("ni,ni->n", middle - places, ways)
        if not (depth > 0.0).mean() > 0.5:
            raise InputError(
                "the photographs do not look at one place, but away from each other: take them all around one object"
            )
        up = -np.stack([camera.world_to_camera[1, :3] for camera in cameras]).mean(axis=0)
        rotation = _axes(up, ways[0])
        scale = 1.0 / float(np.linalg.norm(middle - places, axis=1).mean())
        return self.moved(rotation, -scale * rotation @ middle, scale)


def _axes(up: Array, ahead: Array) -> Array:
    """Rotation whose rows are x, y and z: z along `up`, y nearest to `ahead`."""
    z = up / max(float(np.linalg.norm(up)), 1e-12)
    y = ahead - (ahead @ z) * z
    if np.linalg.norm(y) < 1e-6 or np.linalg.norm(z) < 0.5:
        return np.eye(3)
    y /= np.linalg.norm(y)
    return np.stack([np.cross(y, z), y, z])
