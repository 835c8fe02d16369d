"""Patch meshes: triangles for the light of higher orders on surfaces, small where other matter is near.

Exact shapes become meshes; large triangles are parted, and meshes of very many triangles are made coarser by joining
their vertices in the cells of a grid (Rossignac & Borrel 1993).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hagoromo.image.scene.scene import Scene
from hagoromo.image.scene.shape_mesh import shape_mesh
from hagoromo.image.scene.surface import Surface
from hagoromo.transport.field.patches import PatchMesh

MOST_PATCHES = 6000  # of all surfaces together, about
FEWEST_PATCHES = 300  # of one surface
COARSEST, FINEST = 1.0 / 16.0, 1.0 / 100.0  # edges of triangles, in sizes of their surface
NEARNESS = 0.3  # edge of a triangle over its distance to other matter
ROUND, BALL = 48, 3  # edges around a cylinder or a disk, halvings of those of a ball
FLAT = 1e-4  # distance of a mesh from its surface that rounding may make, in sizes
Mesh = tuple[NDArray[np.float64], NDArray[np.intp]]


def patch_meshes(scene: Scene) -> list[PatchMesh]:
    """Meshes of the surfaces of a scene, in its coordinates."""
    boxes = [thing.corners() for thing in (*scene.boxes, *scene.surfaces)]
    bounds = [(corners.min(axis=0), corners.max(axis=0)) for corners in boxes]
    budget = max(MOST_PATCHES // len(scene.surfaces), FEWEST_PATCHES)
    first, meshes = sum(len(box.materials) for box in scene.boxes), []
    for number, surface in enumerate(scene.surfaces):
        others = [each for k, each in enumerate(bounds) if k != len(scene.boxes) + number]
        vertices, faces, apart = base_mesh(surface, budget)
        size = float(np.linalg.norm(np.ptp(surface.corners(), axis=0)))
        vertices, faces = parted(vertices, faces, size, others, budget)
        first_corner = vertices[faces[:, 0]]
        across = np.cross(vertices[faces[:, 1]] - first_corner, vertices[faces[:, 2]] - first_corner)
        faces = faces[np.linalg.norm(across, axis=1) > 1e-12 * size**2]
        meshes.append(PatchMesh(vertices, faces, first + number, apart + FLAT * size))
    return meshes


def base_mesh(surface: Surface, budget: int) -> tuple[NDArray[np.float64], NDArray[np.intp], float]:
    """Vertices in the world, faces, and the largest distance from the surface [m]."""
    linear, shift, apart = surface.pose[:3, :3], surface.pose[:3, 3], 0.0
    largest = float(np.linalg.norm(linear, 2))
    if surface.vertices is not None and surface.faces is not None:
        vertices, faces = np.asarray(surface.vertices, float), np.asarray(surface.faces, np.intp)
        if len(faces) > 2 * budget:
            vertices, faces, apart = coarser(vertices, faces, budget)
    else:
        vertices, faces, apart = shape_mesh(surface.shape, ROUND, BALL)
    return vertices @ linear.T + shift, faces, apart * largest


def coarser(
    vertices: NDArray[np.float64], faces: NDArray[np.intp], budget: int
) -> tuple[NDArray[np.float64], NDArray[np.intp], float]:
    """A mesh of about `budget` triangles, whose vertices are means of those in the cells of a grid."""
    corners = vertices[faces]
    area = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum()
    edge = float(np.sqrt(2.0 * area / budget))
    cell = np.floor((vertices - vertices.min(axis=0)) / edge).astype(np.int64)
    _, place, count = np.unique(cell, axis=0, return_inverse=True, return_counts=True)
    place = place.ravel()
    means = np.stack([np.bincount(place, vertices[:, k]) for k in range(3)], axis=-1) / count[:, None]
    joined = place[faces]
    whole = (joined[:, 0] != joined[:, 1]) & (joined[:, 1] != joined[:, 2]) & (joined[:, 2] != joined[:, 0])
    joined = joined[whole]
    _, first = np.unique(np.sort(joined, axis=1), axis=0, return_index=True)
    return means, joined[np.sort(first)], edge


def parted(
    vertices: NDArray[np.float64],
    faces: NDArray[np.intp],
    size: float,
    others: list[tuple[NDArray[np.float64], NDArray[np.float64]]],
    budget: int,
) -> Mesh:
    """A mesh of which triangles were parted in four, the worst first, up to about `budget`: see `excess`."""
    from trimesh.remesh import subdivide

    while len(faces) < budget:
        worst = excess(vertices[faces], size, others)
        chosen = np.flatnonzero(worst > max(1.0, 0.5 * worst.max()))
        chosen = chosen[: (budget - len(faces)) // 3 + 1]
        if not chosen.size:
            break
        vertices, faces, *_ = subdivide(vertices, faces, face_index=chosen)
    return np.asarray(vertices), np.asarray(faces, np.intp)


def excess(
    corners: NDArray[np.float64], size: float, others: list[tuple[NDArray[np.float64], NDArray[np.float64]]]
) -> NDArray[np.float64]:
    """Longest edges of triangles (n, 3, 3) over what they should be, from their distance to the bounds of others."""
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    distance = np.full(len(corners), np.inf)
    low, high = corners.min(axis=1), corners.max(axis=1)
    for begin, end in others:
        gap = np.maximum(np.maximum(begin - high, low - end), 0.0)
        distance = np.minimum(distance, np.linalg.norm(gap, axis=1))
    return longest / np.clip(NEARNESS * distance, FINEST * size, COARSEST * size)
