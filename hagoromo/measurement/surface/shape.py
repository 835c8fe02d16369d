"""Shape under near lamps: normals and depth, which depend on each other, by alternating estimates.

Enters: a Capture whose near lamps and camera are known, and the approximate distance of the object. Leaves: normals,
body colours and gloss, and the surface with its variance. The photographs determine the depth too, by direction and
fall-off of the lamps: that of the whole in the joint fit, that of each part by `depth_update`.

Depth update: the change of each pixel's depth for which photographs under near lamps fit best.

Moving a point along its line of sight changes the directions to the lamps and the irradiance of each. The change is a
Gauss–Newton step on the residuals of `pixel_fit`, with normal and body colour free; a single pixel determines it
poorly, a thousand well.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import arrays
from hagoromo.errors import InputError
from hagoromo.least_squares.fit_status import FitStatus, Status
from hagoromo.least_squares.loss import CAUCHY_SCALE
from hagoromo.measurement.normals.gloss_choice import BY_EVIDENCE, GlossModel
from hagoromo.measurement.normals.normals import (
    NormalMap,
    smooth,
    solve_with_one_lobe,
    with_further_lobes,
    with_normals_of_lobes,
    with_own_gloss,
    with_shared_errors,
)
from hagoromo.measurement.normals.photometric_model import Fit, Prior, precision
from hagoromo.measurement.normals.photometric_rounds import independent_share
from hagoromo.measurement.normals.pixel_fit import PixelConditions, PixelData, frame
from hagoromo.measurement.normals.views import UNLIT, Array, Views
from hagoromo.measurement.surface.depth import DepthEstimate, DepthSurface, surface_from_normals, surface_of
from hagoromo.photograph.capture import Capture
from hagoromo.progress import Progress, silent

SIMPLE = GlossModel("gaussian", "neutral")
SHAPE_ROUNDS = 6
SIMPLE_ROUNDS = 2  # first rounds, with Lambertian bodies and lamps where they are stated: the shape is still wrong
CONVERGED_CHANGE = 5e-4  # rms change of ln depth in a round below which the rounds have converged
FIXED_SCALE = 1e-3  # scale of the prior of quantities that are held fixed in the first rounds
LARGEST_CHANGE = 0.1  # of ln depth of a pixel in one round
STRIDE = 1e-3  # of the distance to the eye: step of the finite differences


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
    ended = FitStatus(status, round_ + 1, last_step=change)
    normal_map = with_normals_of_lobes(capture, with_further_lobes(capture, smooth(normal_map)))
    normal_map = with_shared_errors(with_own_gloss(normal_map))
    if normal_map.fit.own is not None:
        depth = depth_estimate(normal_map)
    surface = surface_of(normal_map, camera, middle, depth)
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


class DepthUpdate(NamedTuple):
    """change: (P,) best change of ln distance of each pixel; precision: (P,) inverse of its variance, 0 if unknown."""

    change: Array
    precision: Array


def depth_update(views: Views, light: PixelConditions, normals: Array, body: Array) -> DepthUpdate:
    """The best change of the distance from the eye, by the residuals at `normals` (P, 3) and `body` (C, P)."""
    towards, brighter = _farther(views)
    data = PixelData(views, light)
    normal, colour = data.vectors(normals), [data.floats(channel) for channel in body]
    equations = data.equations(normal, colour)
    sums = _sums(data, normal, colour, data.floats(towards), data.floats(brighter))
    own, a_depth, b_depth, rhs, *by_body = sums
    turns = equations.reduced(0.0)
    for c, h in enumerate(turns.bodies):
        a, b, d, left = equations.a_body[c], equations.b_body[c], by_body[c], equations.rhs_body[c]
        a_depth, b_depth, own = a_depth - a * d / h, b_depth - b * d / h, own - d * d / h
        rhs = rhs - d * left / h
    turn_a = (turns.bb * a_depth - turns.ab * b_depth) / turns.determinant
    turn_b = (turns.aa * b_depth - turns.ab * a_depth) / turns.determinant
    precision = dr.fmax(own - a_depth * turn_a - b_depth * turn_b, 0.0).numpy().astype(np.float64)
    wanted = (rhs - turns.rhs_a * turn_a - turns.rhs_b * turn_b).numpy().astype(np.float64)
    known = precision > 0.0
    return DepthUpdate(np.where(known, wanted / np.where(known, precision, 1.0), 0.0), precision)


def _farther(views: Views) -> tuple[Array, Array]:
    """Directions to the lamps (K, P, 3) and ratio of their irradiance (K, P), at points a STRIDE farther away."""
    points = views.farther(1.0 + STRIDE)
    towards, ratios = [], []
    for lamp in views.lamps:
        before = lamp.direction_and_irradiance(views.points)[1].reshape(len(points), -1).sum(axis=1)
        direction, after = lamp.direction_and_irradiance(points)
        after, least = after.reshape(len(points), -1).sum(axis=1), UNLIT * before.max()
        towards.append(direction)
        ratios.append(np.maximum(after, least) / np.maximum(before, least))
    return np.stack(towards), np.stack(ratios)


def _sums(data: PixelData, normal: Any, body: list[Any], towards: Any, brighter: Any) -> list[Any]:
    """Per pixel: depth × depth, turns × depth (two), right-hand side of depth, and body × depth of each channel."""
    jit, c = arrays(), data.channels
    pixel, turns = dr.arange(jit.UInt, data.pixels), frame(normal)
    start = [dr.zeros(jit.Float, data.pixels) for _ in range(4 + c)]

    def add(lamp: Any, *sums: Any) -> tuple[Any, ...]:
        index = lamp * data.width + pixel
        scale, more = dr.gather(jit.Float, data.evenness, index), dr.gather(jit.Float, brighter, index)
        shade, turned = data.shade(normal, dr.gather(jit.Array3f, data.to_lamp, index), turns)
        farther, _ = data.shade(normal, dr.gather(jit.Array3f, towards, index), turns)
        new = list(sums)
        for i in range(c):
            sample = (lamp * c + i) * data.width + pixel
            model = scale * data.value(body, i, shade)
            slope = (more * scale * data.value(body, i, farther) - model) * (1.0 / STRIDE)
            deviation = dr.gather(jit.Float, data.values, sample) - model
            precision = dr.gather(jit.Float, data.precision, sample)
            weight = precision / (1.0 + deviation * deviation * precision * (1.0 / CAUCHY_SCALE**2))
            a, b = (scale * data.value(body, i, by) for by in turned)
            for j, by in enumerate((slope, a, b, deviation)):
                new[j] += weight * slope * by
            new[4 + i] += weight * slope * scale * shade[0]
        return lamp + 1, *new

    _, *sums = dr.while_loop((dr.zeros(jit.UInt, data.pixels), *start), lambda lamp, *_: lamp < data.lamps, add)
    dr.eval(*sums)
    return sums
