"""Needed bricks: those that a picture takes of its boxes, so that no others are fetched from a store.

Enters: a scene whose boxes may lack their voxels. Leaves, per box, which of its bricks the camera may see, and which
may stand between a lamp and what it sees: a brick is taken for the ball around it, and all that is seen for a cuboid.
Both are larger than need be, never smaller.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.camera import Camera
from hagoromo.image.scene.scene import Scene
from hagoromo.image.scene.settings import Settings
from hagoromo.light.lamp import Lamp
from hagoromo.transport.shadow import ROUGH_FIGURES, fitting_resolution, voxels_across
from hagoromo.volume.box import VolumeBox
from hagoromo.volume.voxels import BRICK

MARGIN_VOXELS = 2.0  # around a brick: interpolation, and steps that begin a little before it
BIASES = 3.0  # of the shadow bias, by which shadow rays may begin elsewhere at most
LENS_MARGIN = 0.1  # of the picture's width, beyond its sides, for a lens with distortion
TEXELS = 8.0  # of a shadow map, from a place to those that its look-up reads; a texel of an octahedron is 1.6 as wide
Array = NDArray[np.float64]


def needed_bricks(scene: Scene, settings: Settings) -> list[NDArray[np.bool_]]:
    """Per box, whether each of its stored bricks is needed; all of them of a box with a texel, of a camera with an
    aperture, and under lamps with a size or an environment.
    """
    if scene.camera.aperture > 0.0 or scene.has_wide_lights:
        return [np.ones(len(box.bricks.places), bool) for box in scene.boxes]
    balls = [_balls(box) for box in scene.boxes]
    needed = [_may_see(scene.camera, *ball) for ball in balls]
    if settings.shadows != "none":
        seen = [
            middle + sign * radius
            for (centres, radius), mask in zip(balls, needed, strict=True)
            for middle in (centres[mask],)
            for sign in (-1.0, 1.0)
        ]
        points = np.concatenate([*seen, *(surface.corners() for surface in scene.surfaces)])
        if len(points):
            bounds = points.min(axis=0), points.max(axis=0)
            margin = _margin(scene, settings)
            for lamp in scene.lamps:
                needed = [mask | _shades(lamp, *ball, bounds, margin) for mask, ball in zip(needed, balls, strict=True)]
    return [np.ones_like(mask) if box.texel else mask for box, mask in zip(scene.boxes, needed, strict=True)]


def _balls(box: VolumeBox) -> tuple[Array, float]:
    """Centres (n, 3) in the world and radius of balls around the stored bricks [m]."""
    middle = (box.bricks.places[:, ::-1] * BRICK + 0.5 * BRICK + 0.5) * box.voxel_size
    radius = np.sqrt(3.0) * (0.5 * BRICK + MARGIN_VOXELS) * box.voxel_size
    return middle @ box.pose[:3, :3].T + box.pose[:3, 3], float(radius)


def _may_see(camera: Camera, centres: Array, radius: float) -> NDArray[np.bool_]:
    """Whether balls reach into the pyramid of the picture."""
    local = centres @ camera.world_to_camera[:3, :3].T + camera.world_to_camera[:3, 3]
    margin = LENS_MARGIN * camera.width if any(camera.distortion) else 0.0
    (ax, ay), (x0, y0) = camera.focal, camera.principal
    sides = np.array([
        (0.0, 0.0, 1.0),
        (ax, 0.0, x0 + margin),
        (-ax, 0.0, camera.width + margin - x0),
        (0.0, ay, y0 + margin),
        (0.0, -ay, camera.height + margin - y0),
    ])  # fmt: skip
    distance = local @ (sides / np.linalg.norm(sides, axis=1, keepdims=True)).T
    return (distance > -radius).all(axis=1)


def _shades(lamp: Lamp, centres: Array, radius: float, bounds: tuple[Array, Array], margin: float) -> NDArray[np.bool_]:
    """Whether balls may stand between a lamp and the cuboid of `bounds`: whether light through them goes on into it.

    Under a near lamp a ball's shadow grows with the distance from the lamp, up to that of the farthest corner.
    """
    low, high = bounds
    if not lamp.near:
        onwards, grown = np.broadcast_to(-lamp.place, centres.shape), np.full(len(centres), radius)
    else:
        onwards = centres - lamp.place
        away = np.linalg.norm(onwards, axis=1)
        corners = np.where(np.abs(low - lamp.place) > np.abs(high - lamp.place), low, high)
        farthest = float(np.linalg.norm(corners - lamp.place))
        grown = radius * np.maximum(farthest / np.maximum(away - radius, 1e-3 * radius), 1.0)
        margin *= max(farthest / max(farthest - float(np.linalg.norm(high - low)), 1e-3 * farthest), 1.0)
    wider = (grown + margin)[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        first, second = (low - wider - centres) / onwards, (high + wider - centres) / onwards
    inside = (centres >= low - wider) & (centres <= high + wider)
    still = onwards == 0.0
    enter = np.where(still, np.where(inside, -np.inf, np.inf), np.minimum(first, second)).max(axis=1)
    leave = np.where(still, np.where(inside, np.inf, -np.inf), np.maximum(first, second)).min(axis=1)
    return (leave >= 0.0) & (enter <= leave)


def _margin(scene: Scene, settings: Settings) -> float:
    """How far beside its own way the light of a lamp may be looked up [m]: in a shadow map, and by the shadow bias."""
    bias = BIASES * max(box.shadow_bias for box in scene.boxes)
    if settings.shadows != "map":
        return bias
    fewest = ROUGH_FIGURES[0] * fitting_resolution(
        scene.boxes, settings.tolerance
    )  # whether matter is rough is not known
    resolution = settings.shadow_resolution or fewest
    across = voxels_across(scene.boxes) * min(box.voxel_size for box in scene.boxes)
    return bias + TEXELS * across / resolution
