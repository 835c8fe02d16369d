"""A march as a user of Numba writes it: a dense grid, trilinear, equal steps, shadows by marching to every lamp."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray
from peers_scene import ALPHA, EYE, INTENSITY, VOXEL, PeerScene

REFERENCE_END_TRANSMITTANCE = 1e-3  # transmittance where a ray ends
REFERENCE_OPAQUE_DEPTH = 10.0  # optical depth where a shadow is black


def frames(scene: PeerScene) -> dict[str, Callable[[], NDArray]]:
    """Whole-voxel and half-voxel steps: pictures (pixels, pixels)."""
    study = scene.study
    axis = scene.axis if study.element == "plane" else np.zeros((1, 1, 1, 3), np.float32)
    directions, lamps = scene.directions.astype(np.float32), scene.lamps.astype(np.float32)
    settings = np.float32(scene.tau), study.element == "plane", study.shadows, study.far
    return {
        f"step {step:g} voxel": lambda step=step: march(
            scene.density, axis, directions, lamps, np.float32(step * VOXEL), *settings
        )
        for step in (1.0, 0.5)
    }


@njit(parallel=True, fastmath=True, cache=True)
def march(density, axis, directions, lamps, step, tau, plane, shadows, far):
    """Radiance of every pixel: front to back, one scattering event."""
    height, width = directions.shape[:2]
    picture = np.zeros((height, width), np.float32)
    for row in prange(height):
        for column in range(width):
            direction = directions[row, column]
            x, y, z = np.float32(EYE[0]), np.float32(EYE[1]), np.float32(EYE[2])
            dx, dy, dz = direction[0], direction[1], direction[2]
            near, far_end = crossing(x, y, z, dx, dy, dz)
            t = max(near, np.float32(0.0)) + np.float32(0.5) * step
            passed, light = np.float32(1.0), np.float32(0.0)
            while t < far_end and passed > REFERENCE_END_TRANSMITTANCE:
                px, py, pz = x + t * dx, y + t * dy, z + t * dz
                depth = tau * trilinear(density, px, py, pz) * step
                if depth > 0.0:
                    met = np.float32(0.0)
                    for k in range(lamps.shape[0]):
                        met += lit(density, axis, px, py, pz, dx, dy, dz, lamps[k], step, tau, plane, shadows, far)
                    through = math.exp(-depth)
                    light += passed * (np.float32(1.0) - through) * met
                    passed *= through
                t += step
            picture[row, column] = light
    return picture


@njit(fastmath=True, cache=True)
def lit(density, axis, x, y, z, dx, dy, dz, lamp, step, tau, plane, shadows, far):
    """Radiance towards the eye that one lamp gives per scattered share at a point."""
    lx, ly, lz = lamp[0], lamp[1], lamp[2]
    irradiance, distance = np.float32(1.0), np.float32(1e9)
    if not far:
        lx, ly, lz = lx - x, ly - y, lz - z
        distance = math.sqrt(lx * lx + ly * ly + lz * lz)
        lx, ly, lz = lx / distance, ly / distance, lz / distance
        irradiance = np.float32(INTENSITY) / (distance * distance)
    if plane:
        nx, ny, nz = normal(axis, x, y, z)
        f = np.float32(ALPHA) * (nx * lx + ny * ly + nz * lz)
        if -(nx * dx + ny * dy + nz * dz) <= 0.0:
            f = np.float32(0.0)
    else:
        cosine = min(max(-(lx * dx + ly * dy + lz * dz), np.float32(-1.0)), np.float32(1.0))
        phase = math.acos(cosine)
        f = np.float32(ALPHA * 2.0 / (3.0 * math.pi)) * (math.sin(phase) + (math.pi - phase) * cosine)
    if f <= 0.0:
        return np.float32(0.0)
    return f * irradiance * (transmittance(density, x, y, z, lx, ly, lz, distance, step, tau) if shadows else 1.0)


@njit(fastmath=True, cache=True)
def transmittance(density, x, y, z, lx, ly, lz, distance, step, tau):
    """Share of a lamp's light that arrives at a point."""
    end = min(crossing(x, y, z, lx, ly, lz)[1], distance)
    t, depth = np.float32(0.5) * step, np.float32(0.0)
    while t < end and depth < REFERENCE_OPAQUE_DEPTH:
        depth += tau * trilinear(density, x + t * lx, y + t * ly, z + t * lz) * step
        t += step
    return math.exp(-depth)


@njit(fastmath=True, cache=True)
def crossing(x, y, z, dx, dy, dz):
    """Distances at which a line enters and leaves the cube −1…1."""
    near, far = np.float32(-1e9), np.float32(1e9)
    for place, slope in ((x, dx), (y, dy), (z, dz)):
        if abs(slope) > 1e-9:
            a, b = (-1 - place) / slope, (1 - place) / slope
            near, far = max(near, min(a, b)), min(far, max(a, b))
    return near, far


@njit(fastmath=True, cache=True)
def corner(x, y, z, n):
    """First of the eight voxels around a point, and where the point is between them."""
    scale, last = np.float32(n / 2), np.float32(n - 1.001)
    a = min(max((x + 1) * scale - np.float32(0.5), np.float32(0.0)), last)
    b = min(max((y + 1) * scale - np.float32(0.5), np.float32(0.0)), last)
    c = min(max((z + 1) * scale - np.float32(0.5), np.float32(0.0)), last)
    i, j, k = int(a), int(b), int(c)
    return i, j, k, a - np.float32(i), b - np.float32(j), c - np.float32(k)


@njit(fastmath=True, cache=True)
def trilinear(grid, x, y, z):
    """Density at a point."""
    i, j, k, a, b, c = corner(x, y, z, grid.shape[0])
    low = (grid[k, j, i] * (1 - a) + grid[k, j, i + 1] * a) * (1 - b)
    low += (grid[k, j + 1, i] * (1 - a) + grid[k, j + 1, i + 1] * a) * b
    high = (grid[k + 1, j, i] * (1 - a) + grid[k + 1, j, i + 1] * a) * (1 - b)
    high += (grid[k + 1, j + 1, i] * (1 - a) + grid[k + 1, j + 1, i + 1] * a) * b
    return low * (1 - c) + high * c


@njit(fastmath=True, cache=True)
def normal(axis, x, y, z):
    """Unit normal at a point."""
    i, j, k, a, b, c = corner(x, y, z, axis.shape[0])
    nx, ny, nz = np.float32(0.0), np.float32(0.0), np.float32(0.0)
    for dk in range(2):
        for dj in range(2):
            for di in range(2):
                weight = (a if di else 1 - a) * (b if dj else 1 - b) * (c if dk else 1 - c)
                voxel = axis[k + dk, j + dj, i + di]
                nx, ny, nz = nx + weight * voxel[0], ny + weight * voxel[1], nz + weight * voxel[2]
    length = math.sqrt(nx * nx + ny * ny + nz * nz) + np.float32(1e-9)
    return nx / length, ny / length, nz / length
