"""Shape: normals and depth under near lamps, which each need the other: normals → surface → lamps as seen from there.

Enters: a Capture whose near lamps and camera are known, and roughly how far away the object is. Leaves: normals, body
colours and gloss, and the surface with its variance. The photographs tell the depth as well, through direction and
fall-off of the lamps: that of the whole in the joint fit, that of each part by `depth_pull`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.least_squares import FitStatus, Status
from hagoromo.measurement.normals.normals import NormalMap, solve_normals
from hagoromo.measurement.normals.photometric_fit import independent_share
from hagoromo.measurement.normals.photometric_model import Fit, precision
from hagoromo.measurement.normals.photometric_prior import Prior
from hagoromo.measurement.normals.pixel_fit import Light
from hagoromo.measurement.normals.views import Array, Views
from hagoromo.measurement.surface.depth import DepthTold, Surface, surface_from_normals
from hagoromo.measurement.surface.depth_pull import depth_pull
from hagoromo.photograph.capture import Capture
from hagoromo.progress import Progress, silent

SHAPE_ROUNDS = 6
SIMPLE = 2  # rounds in which bodies are Lambert's and lamps where they are said to be: the shape is still wrong
SETTLED = 5e-4  # rms change of ln depth from one round to the next that ends them
STRICT = 1e-3  # scale of what is held still in those rounds
LONGEST = 0.1  # of ln depth that one round moves a pixel by


@dataclass(frozen=True, eq=False)
class Shape:
    """found: the normals and what came with them; surface: the points that go with them; rounds that it took.

    status: how the rounds ended; the last step is the rms change of ln depth in the last of them.
    """

    found: NormalMap
    surface: Surface
    rounds: int
    status: FitStatus


def has_near_lamps(capture: Capture) -> bool:
    """Whether a lamp of the capture has a position."""
    return any(lamp.position is not None for photograph in capture.photographs for lamp in photograph.lamps)


def solve_shape(capture: Capture, distance: float, prior: Prior | None = None, progress: Progress = silent) -> Shape:
    """Normals and surface of `capture` under near lamps, from a first guess of its mean depth `distance` [m].

    Points of the capture, if it has them, are where it starts from. `InputError` as `solve_normals`, and for a distance
    that is none.
    """
    prior = prior or Prior()
    camera = capture.photographs[0].camera
    if not (np.isfinite(distance) and distance > 0.0):
        raise InputError(f"the distance of the surface is {distance} m: give a length above 0")
    points = capture.points
    if points is None:
        rays = camera.pixel_directions()
        points = camera.position + rays * (distance / (rays @ camera.camera_to_world[:3, 2]))[..., None]
    labels: NDArray[np.integer] | None = np.zeros((camera.height, camera.width), np.intp)
    strict = replace(prior, strength=STRICT, slope=STRICT, direction=STRICT, roughness=STRICT, exponent=STRICT)
    status, change = Status.OUT_OF_STEPS, np.inf
    for round_ in range(SHAPE_ROUNDS):
        progress(round_ / SHAPE_ROUNDS, f"shape, round {round_ + 1}")
        here = replace(capture, points=np.asarray(points, np.float32))
        early = round_ < SIMPLE
        found = solve_normals(here, labels if early else None, strict if early else prior)
        told = depth_told(found)
        middle = float(np.median(np.exp(told.log_depth[told.precision > 0.0])))
        surface = surface_from_normals(found.normals, camera, middle, found.variance, told, draws=0)
        change = _change(points, surface.points, camera.position)
        points = np.where(found.variance[..., None] < np.inf, surface.points, points)
        if not early and change < SETTLED:
            status = Status.CONVERGED
            break
    surface = surface_from_normals(found.normals, camera, middle, found.variance, told)
    progress(1.0, "")
    ended = FitStatus(status, round_ + 1, last_step=change)
    return Shape(replace(found, fit=replace(found.fit, shape_status=ended)), surface, round_ + 1, ended)


def depth_told(found: NormalMap) -> DepthTold:
    """What the photographs tell of each pixel's depth at the normals `found`; errors are shared as residuals are."""
    fit, seen = found.fit, found.seen
    pull = depth_pull(seen, light_of(fit, seen), fit.normals, fit.body)
    share = independent_share(seen, fit) * seen.values.shape[1]
    depth = np.log((seen.points - seen.eye) @ seen.axis) + np.clip(pull.change, -LONGEST, LONGEST)
    return DepthTold(seen.image(depth), seen.image(share * pull.precision))


def light_of(fit: Fit, seen: Views) -> Light:
    """What the fit of the pixels takes as known, as `fit` has it."""
    return Light(fit.gloss.rows[fit.labels], fit.evenness(seen.place), precision(seen, fit.model_error))


def _change(before: NDArray[np.floating], after: NDArray[np.floating], eye: Array) -> float:
    """Rms change of ln distance."""
    known = np.linalg.norm(after, axis=2) > 0.0  # of the whole, where something was solved
    lengths = [np.linalg.norm(one[known] - eye, axis=1) for one in (before, after)]
    return float(np.sqrt(np.mean(np.log(lengths[1] / np.maximum(lengths[0], 1e-9)) ** 2)))
