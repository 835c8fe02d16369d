"""Solve the shape of a capture that does not know it: normals from its many lamps, points by integrating them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from hagoromo.errors import InputError
from hagoromo.photograph.capture import Capture
from hagoromo.reflectance.depth import points_from_normals
from hagoromo.reflectance.normals import solve_normals


def solve_shape(
    capture: Capture, distance: float | None = None, progress: Callable[[float, str], None] | None = None
) -> Capture:
    """`capture` as it is where it knows its points and normals, else with those solved.

    distance: mean distance of the object along the camera's axis [m]; None takes the camera's from the world's origin.
    `InputError` when the photographs cannot tell normals, or the camera stands at the origin and no distance is given.
    """
    if capture.points is not None and capture.normals is not None:
        return capture
    camera = capture.photographs[0].camera
    away = float(np.linalg.norm(camera.position)) if distance is None else distance
    if away == 0.0:
        raise InputError("the camera stands at the world's origin and the capture has no shape: give --distance")
    found = solve_normals(capture, progress=progress)
    points = points_from_normals(found.normals, camera, away, found.variance)
    return replace(capture, points=points, normals=found.normals)
