"""Cast shadows of a surface on itself under a far lamp, with the surface as a height field seen from the camera."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import hagoromo as hg

NEAR_PX = 40  # distance [px] sampled in steps of one pixel; beyond, steps grow by a twentieth
CLEARANCE_PX = 1.0  # depth [px] by which a ray must clear the surface, half of it to full shadow
FAR_AWAY = 1e9  # depth where there is no surface


def lit_share(points: NDArray[np.floating], camera: hg.Camera, to_lamp: NDArray[np.float64]) -> NDArray[np.float64]:
    """Share (h, w) of a far lamp's light that its own surface lets pass, 1 lit to 0 in cast shadow; 1 where unknown.

    points: (h, w, 3) [m], world, 0 where unknown. to_lamp: (3,) unit, world. The view is assumed orthographic. Surfaces
    outside the picture or behind the visible surface cast no shadow.
    """
    from scipy.ndimage import map_coordinates

    known = np.asarray(np.linalg.norm(points, axis=2) > 0.0)
    rows, columns = np.nonzero(known)
    pose = camera.world_to_camera[:3]
    depth = points[rows, columns].astype(np.float64) @ pose[2, :3] + pose[2, 3]
    height = np.full(known.shape, FAR_AWAY)
    height[rows, columns] = depth / (depth.mean() / np.mean(camera.focal))  # [px]
    lit = np.ones(known.shape)
    across, down, forward = pose[:, :3] @ to_lamp
    lateral = float(np.hypot(across, down))
    if lateral < 1e-6:
        return lit
    across, down, climb = across / lateral, down / lateral, -forward / lateral
    nearest = float(height.min())
    place = np.stack([rows, columns]).astype(np.float64)
    level, clearance = height[rows, columns], np.full(len(rows), np.inf)
    reach = min((float(level.max()) - nearest) / max(climb, 1e-3), float(np.hypot(*known.shape)))
    for walked in _strides(reach):
        ray = level - climb * walked
        active = np.nonzero(ray > nearest)[0]
        if not len(active):
            break
        position = place[:, active] + walked * np.array([[down], [across]])
        surface_height = map_coordinates(height, position, order=1, mode="constant", cval=FAR_AWAY)
        clearance[active] = np.minimum(clearance[active], surface_height - ray[active])
    lit[rows, columns] = np.clip((clearance + CLEARANCE_PX) / (0.5 * CLEARANCE_PX), 0.0, 1.0)
    return lit


def _strides(reach: float) -> NDArray[np.float64]:
    """Distances [px] of the samples along a ray: 1, 2, … NEAR_PX, then growing steps up to `reach`."""
    near = np.arange(1.0, min(NEAR_PX, reach) + 1.0)
    if reach <= NEAR_PX:
        return near
    count = int(np.ceil(np.log(reach / NEAR_PX) / np.log(1.05)))
    return np.concatenate([near, NEAR_PX * 1.05 ** np.arange(1, count + 1)])
