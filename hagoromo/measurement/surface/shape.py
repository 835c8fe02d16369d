"""Shape under near lamps: normals and depth, which depend on each other, by alternating estimates.

Enters: a Capture whose near lamps and camera are known, and the approximate distance of the object. Leaves: normals,
body colours and gloss, and the surface with its variance. The photographs determine the depth too, by direction and
fall-off of the lamps: that of the whole in the joint fit, that of each part by `depth_update`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.least_squares.fit_status import FitStatus, Status
from hagoromo.measurement.normals.gloss_choice import BY_EVIDENCE, GlossModel
from hagoromo.measurement.normals.independent_share import independent_share
from hagoromo.measurement.normals.normals import NormalMap, solve_with_one_lobe, with_further_lobes, with_own_gloss
from hagoromo.measurement.normals.photometric_model import Fit, Prior, precision
from hagoromo.measurement.normals.pixel_fit import PixelConditions
from hagoromo.measurement.normals.views import Array, Views
from hagoromo.measurement.surface.depth import DepthEstimate, DepthSurface, surface_from_normals
from hagoromo.measurement.surface.depth_update import depth_update
from hagoromo.photograph.capture import Capture
from hagoromo.progress import Progress, silent

SIMPLE = GlossModel("gaussian", "neutral")
SHAPE_ROUNDS = 6
SIMPLE_ROUNDS = 2  # first rounds, with Lambertian bodies and lamps where they are stated: the shape is still wrong
CONVERGED_CHANGE = 5e-4  # rms change of ln depth in a round below which the rounds have converged
FIXED_SCALE = 1e-3  # scale of the prior of quantities that are held fixed in the first rounds
LARGEST_CHANGE = 0.1  # of ln depth of a pixel in one round


@dataclass(frozen=True, eq=False, repr=False)
class SolvedShape:
    """Normals and points of a surface that were solved together.

    normal_map: the normals, body colours and gloss. surface: points [m] and their variance [m²]. rounds: their
    number. status: how the rounds ended; the last step is the rms change of ln depth in the last one.
    """

    normal_map: NormalMap
    surface: DepthSurface
    rounds: int
    status: FitStatus

    def __repr__(self) -> str:
        return f"Shape({self.normal_map!r}, {self.rounds} rounds, {self.status.status.words})"


def has_near_lamps(capture: Capture) -> bool:
    """Whether a lamp of the capture has a position."""
    return any(lamp.position is not None for photograph in capture.photographs for lamp in photograph.lamps)


def solve_shape(
    capture: Capture,
    distance: float,
    prior: Prior | None = None,
    progress: Progress = silent,
    model: GlossModel = BY_EVIDENCE,
) -> SolvedShape:
    """Normals and points of the surface in `capture` under near lamps, solved together in rounds.

    Each round solves the normals with the lamps as seen from the points, and the points from the normals. distance:
    first guess of the mean depth along the axis of the camera [m]; points of the capture, if it has them, replace it.
    prior, model: as in `solve_normals`; Gaussian facets in the first rounds. Raises `InputError` as `solve_normals`,
    and for a distance that is not above 0.
    """
    prior = prior or Prior()
    camera = capture.photographs[0].camera
    if not (np.isfinite(distance) and distance > 0.0):
        raise InputError(f"the distance of the surface is {distance} m: give a length above 0")
    points = capture.points
    if points is None:
        rays = camera.pixel_directions()
        points = camera.position + rays * (distance / (rays @ camera.camera_to_world[:3, 2]))[..., None]
    labels: NDArray[np.integer] = np.zeros((camera.height, camera.width), np.intp)
    strict = replace(
        prior,
        strength=FIXED_SCALE,
        slope=FIXED_SCALE,
        direction=FIXED_SCALE,
        roughness=FIXED_SCALE,
        exponent=FIXED_SCALE,
    )
    status, change = Status.OUT_OF_STEPS, np.inf
    for round_ in range(SHAPE_ROUNDS):
        progress(round_ / SHAPE_ROUNDS, f"shape, round {round_ + 1}")
        at_points = replace(capture, points=np.asarray(points))
        early = round_ < SIMPLE_ROUNDS
        if early:
            normal_map = solve_with_one_lobe(at_points, labels, strict, model=SIMPLE)
        else:
            normal_map = solve_with_one_lobe(at_points, None, prior, model=model)
        depth = depth_estimate(normal_map)
        middle = float(np.median(np.exp(depth.log_depth[depth.precision > 0.0])))
        surface = surface_from_normals(normal_map.normals, camera, middle, normal_map.variance, depth, draws=0)
        change = _change(points, surface.points, camera.position)
        points = np.where(normal_map.variance[..., None] < np.inf, surface.points, points)
        if not early and change < CONVERGED_CHANGE:
            status = Status.CONVERGED
            break
    surface = surface_from_normals(normal_map.normals, camera, middle, normal_map.variance, depth)
    ended = FitStatus(status, round_ + 1, last_step=change)
    normal_map = with_own_gloss(with_further_lobes(capture, normal_map))
    if normal_map.fit.own is not None:
        depth = depth_estimate(normal_map)
        surface = surface_from_normals(normal_map.normals, camera, middle, normal_map.variance, depth)
    progress(1.0, "")
    return SolvedShape(replace(normal_map, fit=replace(normal_map.fit, shape_status=ended)), surface, round_ + 1, ended)


def depth_estimate(normal_map: NormalMap) -> DepthEstimate:
    """The depth of each pixel by the photographs, at these normals; its errors are correlated as residuals are."""
    fit, views = normal_map.fit, normal_map.views
    update = depth_update(views, light_of(fit, views), fit.normals, fit.body)
    share = independent_share(views, fit) * views.values.shape[1]
    log_depth = np.log((views.points - views.eye) @ views.axis) + np.clip(
        update.change, -LARGEST_CHANGE, LARGEST_CHANGE
    )
    return DepthEstimate(views.image(log_depth), views.image(share * update.precision))


def light_of(fit: Fit, views: Views) -> PixelConditions:
    """The known quantities of the pixel fit, from `fit`."""
    return PixelConditions(fit.rows, fit.evenness(views.place), precision(views, fit.model_error))


def _change(before: NDArray[np.floating], after: NDArray[np.floating], eye: Array) -> float:
    """Rms change of ln distance."""
    known = np.linalg.norm(after, axis=2) > 0.0  # where the depth was estimated
    lengths = [np.linalg.norm(one[known] - eye, axis=1) for one in (before, after)]
    return float(np.sqrt(np.mean(np.log(lengths[1] / np.maximum(lengths[0], 1e-9)) ** 2)))
