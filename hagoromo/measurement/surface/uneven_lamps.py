"""Uneven lamps: a capture solved for the strengths and fall-off of its lamps, which may differ by much."""

from __future__ import annotations

from hagoromo.measurement.normals.normals import NormalMap, solve_with_one_lobe
from hagoromo.measurement.normals.photometric_model import Prior
from hagoromo.measurement.surface.shape import has_near_lamps, solve_shape
from hagoromo.photograph.capture import Capture
from hagoromo.progress import Progress, silent

UNEVEN = Prior(strength=0.1, slope=0.1)


def solve_uneven_lamps(capture: Capture, distance: float, progress: Progress = silent) -> NormalMap:
    """The photometric fit of an object of unknown shape, `distance` [m] from the camera, with wide priors of lamps."""
    if has_near_lamps(capture):
        return solve_shape(capture, distance, UNEVEN, progress).normal_map
    return solve_with_one_lobe(capture, prior=UNEVEN, progress=progress)
