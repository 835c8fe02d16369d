"""Shape mesh: triangles of the exact shapes, counterclockwise seen from their front."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def shape_mesh(shape: str, around: int, halvings: int) -> tuple[NDArray[np.float64], NDArray[np.intp], float]:
    """Vertices and faces of one of Mitsuba's shapes of unit size, and how far the mesh is from it.

    around: edges around a cylinder or a disk. halvings: of the edges of an icosahedron for a sphere.
    """
    import trimesh

    sagitta = 1.0 - np.cos(np.pi / around)
    if shape == "sphere":
        ball = trimesh.creation.icosphere(subdivisions=halvings)
        return np.asarray(ball.vertices), np.asarray(ball.faces), 0.384 / 4.0**halvings
    if shape == "cube":
        cube = trimesh.creation.box((2.0, 2.0, 2.0))
        return np.asarray(cube.vertices), np.asarray(cube.faces), 0.0
    if shape == "rectangle":
        return np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]), np.array([[0, 1, 2], [0, 2, 3]]), 0.0
    turn = 2.0 * np.pi * np.arange(around) / around
    ring, next_one = np.column_stack([np.cos(turn), np.sin(turn)]), (np.arange(around) + 1) % around
    this = np.arange(around)
    if shape == "disk":
        vertices = np.concatenate([np.column_stack([ring, 0.0 * turn]), [[0.0, 0, 0]]])
        return vertices, np.column_stack([this, next_one, np.full(around, around)]), sagitta
    vertices = np.concatenate([np.column_stack([ring, z + 0.0 * turn]) for z in (0.0, 1.0)])
    low, high = (
        np.column_stack([this, next_one, next_one + around]),
        np.column_stack([this, next_one + around, this + around]),
    )
    return vertices, np.concatenate([low, high]), sagitta
