"""A march as a user of NumPy and SciPy writes it: all rays step together, the grid is read by map_coordinates."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from peers_scene import ALPHA, EYE, INTENSITY, VOXEL, PeerScene, sphere_phase
from scipy.ndimage import map_coordinates

REFERENCE_END_TRANSMITTANCE = 1e-3  # transmittance where a ray ends
REFERENCE_OPAQUE_DEPTH = 10.0  # optical depth where a shadow is black


def frames(scene: PeerScene) -> dict[str, Callable[[], NDArray]]:
    """Half-voxel steps: the picture (pixels, pixels)."""
    axis = [np.ascontiguousarray(scene.axis[..., k]) for k in range(3)] if scene.study.element == "plane" else None
    return {"step 0.5 voxel": lambda: march(scene, axis, 0.5 * VOXEL)}


def march(scene: PeerScene, axis: list[NDArray] | None, step: float) -> NDArray:
    """Radiance of every pixel: front to back, one scattering event."""
    directions = scene.directions.reshape(-1, 3).astype(np.float32)
    origin = np.array(EYE, np.float32)
    near, far = crossing(origin, directions)
    light, passed = np.zeros(len(directions), np.float32), np.ones(len(directions), np.float32)
    for number in range(int(np.ceil((far - near).max() / step))):
        t = near + (number + 0.5) * step
        going = np.flatnonzero((t < far) & (passed > REFERENCE_END_TRANSMITTANCE))
        points = origin + t[going, None] * directions[going]
        depth = scene.tau * step * read(scene.density, points)
        matter = depth > 0.0
        going, points, depth = going[matter], points[matter], depth[matter]
        met = sum(lit(scene, axis, points, directions[going], lamp, step) for lamp in scene.lamps.astype(np.float32))
        through = np.exp(-depth)
        light[going] += passed[going] * (1.0 - through) * met
        passed[going] *= through
    return light.reshape(scene.study.pixels, -1)


def lit(
    scene: PeerScene, axis: list[NDArray] | None, points: NDArray, directions: NDArray, lamp: NDArray, step: float
) -> NDArray:
    """Radiance towards the eye that one lamp gives per scattered share at points (n, 3)."""
    to_lamp = np.broadcast_to(lamp, points.shape) if scene.study.far else lamp - points
    distance = np.linalg.norm(to_lamp, axis=1)
    to_lamp = to_lamp / distance[:, None]
    irradiance = 1.0 if scene.study.far else INTENSITY / distance**2
    if axis is None:
        f = sphere_phase(-np.einsum("ij,ij->i", to_lamp, directions))
    else:
        normal = np.stack([read(part, points) for part in axis], axis=1)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True) + 1e-9
        seen = np.einsum("ij,ij->i", normal, directions) < 0.0
        f = ALPHA * np.maximum(np.einsum("ij,ij->i", normal, to_lamp), 0.0) * seen
    return f * irradiance * (transmittance(scene, points, to_lamp, step) if scene.study.shadows else 1.0)


def transmittance(scene: PeerScene, points: NDArray, to_lamp: NDArray, step: float) -> NDArray:
    """Share of a lamp's light that arrives at points (n, 3); lamps stand outside the box."""
    _, far = crossing(points, to_lamp)
    depth = np.zeros(len(points), np.float32)
    for number in range(int(np.ceil(far.max(initial=0.0) / step))):
        t = (number + 0.5) * step
        going = np.flatnonzero((t < far) & (depth < REFERENCE_OPAQUE_DEPTH))
        depth[going] += scene.tau * step * read(scene.density, points[going] + t * to_lamp[going])
    return np.exp(-depth)


def crossing(origin: NDArray, direction: NDArray) -> tuple[NDArray, NDArray]:
    """Distances at which lines enter and leave the cube −1…1."""
    with np.errstate(divide="ignore"):
        faces = np.stack([(-1.0 - origin) / direction, (1.0 - origin) / direction])
    return np.maximum(faces.min(axis=0).max(axis=-1), 0.0), faces.max(axis=0).min(axis=-1)


def read(grid: NDArray, points: NDArray) -> NDArray:
    """Trilinear value of `grid` (z, y, x) at points (n, 3)."""
    places = (points[:, ::-1].T + 1.0) / VOXEL - 0.5
    return map_coordinates(grid, places, order=1, mode="nearest", prefilter=False)
