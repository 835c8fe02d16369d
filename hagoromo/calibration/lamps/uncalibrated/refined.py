"""Lamps from photographs of the object itself, refined: one surface, its albedos, its gloss and the lamps together.

Enters: a self-calibration by shading alone, that takes the body for Lambert's. Leaves: the same with highlights, rough
bodies and lamps that light the object unevenly accounted for (`joint_surface.py`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hagoromo.calibration.lamps import check_spread
from hagoromo.calibration.lamps.uncalibrated import SelfCalibration
from hagoromo.calibration.lamps.uncalibrated.colours import colours
from hagoromo.calibration.lamps.uncalibrated.joint_surface import Guess, JointSurface, Seen
from hagoromo.calibration.lamps.uncalibrated.low_rank import FEWEST_LAMPS, Array, lit
from hagoromo.calibration.lamps.uncalibrated.reduced import reduced
from hagoromo.camera.camera import Camera
from hagoromo.least_squares import (
    CAUCHY_SCALE,
    ROBUST_SCALE,
    Damping,
    FitStatus,
    SingleProblem,
    Status,
    Tolerance,
    levenberg_marquardt,
    robust_scale,
)
from hagoromo.measurement.normals.photometric_fit import FLOOR
from hagoromo.measurement.normals.photometric_prior import Prior
from hagoromo.measurement.surface.height_field import height_field
from hagoromo.progress import Progress, silent

MOST_PIXELS = 6000  # of the object
JOINT_SURFACE_ROUNDS, JOINT_SURFACE_STEPS, JOINT_SURFACE_TRIALS = 3, 13, 6
JOINT_SURFACE_DAMPING = Damping(start=1e-2, shrink=6.0, grow=6.0, least=1e-6, most=np.inf, ties=False)
DULL = (-1.5, np.log(0.3), 0.0, 0.0)  # row of gloss at the start
START_ERROR = 0.03  # relative
LEAST = 0.7  # of the median error of all photographs that one's is taken for
SETTLED = 1e-4  # of the cost, and SMALL beside it, that a step gains less than
SMALL = 3e-3
KEPT = 1.0 / 3.0  # of the errors that shading states: no law of reflection is a real body's
BOUNCE_DEG = 1.5
IMAGE_AXES = np.array([1.0, -1.0, -1.0])  # x right, y up, z to the camera, from x right, y down, z forward


def refined_lamps(
    photographs: Mapping[str, NDArray],
    mask: NDArray[np.bool_],
    camera: Camera | None,
    start: SelfCalibration,
    progress: Progress = silent,
) -> SelfCalibration:
    """`start`, of the same photographs, mask and camera, with directions, strengths and their errors refined."""
    light, on_object, tangent = reduced(photographs, mask, camera, MOST_PIXELS)
    turn = np.eye(3) if camera is None else (camera.camera_to_world[:3, :3] * IMAGE_AXES).T
    values, used = lit(light.mean(axis=3)[:, on_object])
    told = used.sum(axis=0) >= max(FEWEST_LAMPS - 1, len(values) // 2)
    on_surface = on_object.copy()
    on_surface[on_object] = told
    strength = np.log(start.strength.mean(axis=1))
    lamps = start.to_lamp @ turn.T * np.exp(strength - strength.mean())[:, None]
    fit, status = _fitted(values[:, told], used[:, told], on_surface, tangent, lamps, progress)
    error, of_strength = _errors(fit, start)
    found = np.exp(fit.guess.lamps[:, :1]) * colours(light[:, on_object])
    to_lamp = fit.guess.to_lamp @ turn
    progress(1.0, "")
    return replace(
        start,
        to_lamp=to_lamp,
        strength=found / np.median(found, axis=0),
        standard_error_deg=error,
        strength_error=of_strength,
        condition=check_spread(to_lamp).condition,
        statuses={**start.statuses, "the joint surface": status},
    )


def _errors(fit: JointSurface, start: SelfCalibration) -> tuple[Array, Array]:
    """(K,) of directions [°] and of ln strength.

    Beside what the fit's curvature says: how far the lamps move when albedos may be many, a share of what shading
    states, and what light from other things (6 % of the lamp's, from below) does to simulated objects.
    """
    guess, (turns, strengths) = fit.guess, fit.variance()
    other = _settled(JointSurface(replace(fit.seen, few=0.0), guess, fit.prior))[0].guess
    moved = np.degrees(np.arccos(np.clip(np.sum(guess.to_lamp * other.to_lamp, axis=1), -1.0, 1.0)))
    ratio = other.lamps[:, 0] - guess.lamps[:, 0]
    directions = [np.degrees(np.sqrt(turns)), moved, KEPT * start.standard_error_deg, np.full(len(moved), BOUNCE_DEG)]
    lengths = [np.sqrt(strengths), ratio - np.median(ratio), KEPT * start.strength_error]
    return np.linalg.norm(directions, axis=0), np.linalg.norm(lengths, axis=0)


def _fitted(
    values: Array,
    used: NDArray[np.bool_],
    mask: NDArray[np.bool_],
    tangent: Array,
    lamps: Array,
    progress: Progress,
) -> tuple[JointSurface, FitStatus]:
    """The joint surface over `mask`, and how its fit ended, from lamps (K, 3) strength times direction."""
    field = height_field(mask, tangent)
    at = np.argwhere(mask)
    place = (at - at.mean(axis=0))[:, ::-1] * [1.0, -1.0] / np.sqrt(len(at) / np.pi)
    scaled = _by_lambert(values, used, lamps)
    size = np.linalg.norm(scaled, axis=1)
    unit = float(np.median(size))
    length = np.linalg.norm(lamps, axis=1, keepdims=True)
    guess = Guess(
        field.through(scaled),
        np.log(np.maximum(size / unit, 1e-3)),
        lamps / length,
        np.column_stack([np.log(length), np.zeros((len(lamps), 2))]),
        np.array(DULL),
    )
    seen, prior = Seen(values / unit, used, place, field, np.full(len(lamps), START_ERROR)), Prior()
    step, status = JointSurface(seen, guess, prior), FitStatus(Status.OUT_OF_STEPS, 0)
    for i in range(JOINT_SURFACE_ROUNDS):
        progress(i / (JOINT_SURFACE_ROUNDS + 1), "surface")
        step, status = _settled(JointSurface(replace(seen, model_error=_model_error(step)), step.guess, prior))
    progress(JOINT_SURFACE_ROUNDS / (JOINT_SURFACE_ROUNDS + 1), "errors")
    return step, status


def _settled(point: JointSurface) -> tuple[JointSurface, FitStatus]:
    """Steps from `point` until they gain little, and how that ended."""
    tolerance = Tolerance(gain=SETTLED, least_gain=SMALL)
    found = levenberg_marquardt(
        SingleProblem(), point, JOINT_SURFACE_DAMPING, tolerance, JOINT_SURFACE_STEPS, JOINT_SURFACE_TRIALS
    )
    return found.state, found.status


def _model_error(step: JointSurface) -> Array:
    """Robust relative error (K,) of the model in each photograph, not far below that of all."""
    seen, used = step.seen, step.seen.used
    relative = np.abs(step.deviation / np.maximum(seen.values, seen.values.mean(axis=0)))
    free = float(np.sqrt(used.sum() / max(used.sum() - 3.0 * used.shape[1], 1.0)))
    whole = float(np.median(relative[used]))
    each = [
        max(float(np.median(off[own])), LEAST * whole) if own.any() else whole
        for off, own in zip(relative, used, strict=True)
    ]
    return np.maximum(ROBUST_SCALE * free * np.array(each), FLOOR)


def _by_lambert(values: Array, used: NDArray[np.bool_], lamps: Array) -> Array:
    """Albedo times normal (P, 3) of each pixel by Lambert's law and Cauchy's weights."""
    size, weight = values.mean(axis=0), used.astype(np.float64)
    scaled = np.zeros((values.shape[1], 3))
    for _ in range(8):
        square = np.einsum("kp,ki,kj->pij", weight, lamps, lamps, optimize=True) + 1e-6 * np.eye(3)
        scaled = np.linalg.solve(square, np.einsum("kp,ki->pi", weight * values, lamps)[..., None])[..., 0]
        off = (values - lamps @ scaled.T) / size
        scale = robust_scale(off[used])
        weight = used / (1.0 + (off / max(CAUCHY_SCALE * scale, 1e-9)) ** 2)
    return scaled
