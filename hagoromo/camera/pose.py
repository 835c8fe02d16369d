"""Rigid poses as (4, 4) matrices, and the axes of other programs' cameras."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hagoromo.errors import InputError

ROTATION_TOLERANCE = 1e-6  # largest entry of R Rᵀ − I in a pose that is taken for a rigid one
FARTHEST = 1e12  # largest number in a pose [m], whose square is still a number
ROUNDING = 1e-12  # the same, up to which a pose is kept to the last bit


def rigid_pose(matrix: ArrayLike, what: str, tolerance: float = ROTATION_TOLERANCE) -> NDArray[np.float64]:
    """A copy of a (4, 4) rigid transformation, or an `InputError` that calls it `what`.

    tolerance: largest entry of R Rᵀ − I that passes; beyond rounding, the rotation nearest to R is given back.
    """
    pose = np.array(matrix, np.float64) if _is_matrix(matrix) else np.empty(0)
    if pose.shape != (4, 4) or not np.isfinite(pose).all() or not np.allclose(pose[3], (0, 0, 0, 1), atol=1e-9):
        raise InputError(f"{what} is no pose: give 4 × 4 finite numbers, the last row 0 0 0 1")
    if np.abs(pose[:3]).max() > FARTHEST:
        raise InputError(f"{what} is no pose: a number in it is above {FARTHEST:g}")
    off = np.abs(pose[:3, :3] @ pose[:3, :3].T - np.eye(3)).max()
    if off > tolerance or np.linalg.det(pose[:3, :3]) < 0.0:
        raise InputError(f"{what} is no rotation (R Rᵀ differs from 1 by {off:.2g}, or mirrors): give a rigid pose")
    if off > ROUNDING:
        u, _, vt = np.linalg.svd(pose[:3, :3])
        pose[:3, :3] = u @ vt
    return pose


def opencv_from_opengl(camera_to_world: ArrayLike) -> NDArray[np.float64]:
    """Camera-to-world (4, 4) for OpenCV's axes from one for OpenGL's and Blender's (+x right, +y up, −z forward)."""
    return np.asarray(camera_to_world, np.float64) @ np.diag([1.0, -1.0, -1.0, 1.0])


def opengl_from_opencv(camera_to_world: ArrayLike) -> NDArray[np.float64]:
    """The inverse of `opencv_from_opengl` (the same flip of y and z)."""
    return opencv_from_opengl(camera_to_world)


def mitsuba_from_opencv(camera_to_world: ArrayLike) -> NDArray[np.float64]:
    """Camera-to-world (4, 4) for Mitsuba's axes (+x left, +y up, +z forward) from one for OpenCV's."""
    return np.asarray(camera_to_world, np.float64) @ np.diag([-1.0, -1.0, 1.0, 1.0])


def pose_of(rotation: ArrayLike, translation: ArrayLike) -> NDArray[np.float64]:
    """(4, 4) of a rotation (3, 3) and a translation (3,)."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, translation
    return pose


def turned_about_axes(degrees: ArrayLike) -> NDArray[np.float64]:
    """(3, 3) rotation by three angles [°]: about x, then y, then z of the world."""
    rotation = np.eye(3)
    for axis, angle in enumerate(np.radians(np.asarray(degrees, np.float64))):
        turn, (i, j) = np.eye(3), ((axis + 1) % 3, (axis + 2) % 3)
        turn[[i, i, j, j], [i, j, i, j]] = np.cos(angle), -np.sin(angle), np.sin(angle), np.cos(angle)
        rotation = turn @ rotation
    return rotation


def inverse_pose(pose: NDArray[np.float64]) -> NDArray[np.float64]:
    """The inverse of a rigid (4, 4) transformation."""
    return pose_of(pose[:3, :3].T, -pose[:3, :3].T @ pose[:3, 3])


def _is_matrix(matrix: ArrayLike) -> bool:
    """Whether all its entries are numbers; true and false, which NumPy takes for 1 and 0, are none."""
    try:
        np.asarray(matrix, np.float64)
        if isinstance(matrix, (list, tuple)) and any(
            isinstance(entry, bool) for row in matrix for entry in (row if isinstance(row, (list, tuple)) else [row])
        ):
            return False
    except (TypeError, ValueError, OverflowError):
        return False
    return True
