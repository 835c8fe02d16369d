"""Calibration of far lamps from photographs of a matte object, one lamp each, without a ball.

Lamps from photographs of an object, refined: one surface, its albedos, its gloss and the lamps are fitted together.

Enters: a self-calibration by shading alone, which assumes a Lambertian body. Leaves: the same, accounting for
highlights, rough bodies and uneven lamps (`joint_surface`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hagoromo.calibration.lamps import check_spread
from hagoromo.calibration.lamps.lamp_photographs import Transfer8, lamp_photographs
from hagoromo.calibration.lamps.uncalibrated.far_lamps import SelfCalibration, self_calibrate
from hagoromo.calibration.lamps.uncalibrated.joint_surface import Guess, JointSurface, SurfaceData, height_field
from hagoromo.calibration.lamps.uncalibrated.low_rank import FEWEST_LAMPS, Array, lit
from hagoromo.calibration.lamps.uncalibrated.scale import colours, reduced
from hagoromo.camera.camera import Camera
from hagoromo.camera.formats.camera_file import read_camera
from hagoromo.errors import InputError
from hagoromo.files.picture import read_picture
from hagoromo.least_squares.fit_status import FitStatus, Status
from hagoromo.least_squares.levenberg_marquardt import Damping, SingleProblem, Tolerance, levenberg_marquardt
from hagoromo.least_squares.loss import CAUCHY_SCALE, ROBUST_SCALE, robust_scale
from hagoromo.measurement.normals.photometric_model import Prior
from hagoromo.measurement.normals.photometric_rounds import SMALLEST_MODEL_ERROR
from hagoromo.progress import Progress, part_of, silent

MOST_PIXELS = 6000  # of the object
JOINT_SURFACE_ROUNDS, JOINT_SURFACE_STEPS, JOINT_SURFACE_TRIALS = 3, 13, 6
JOINT_SURFACE_DAMPING = Damping(start=1e-2, shrink=6.0, grow=6.0, least=1e-6, most=np.inf, ties=False)
JOINT_SURFACE_GAIN, JOINT_SURFACE_LEAST_GAIN = 1e-4, 3e-3  # relative and absolute gain of the last step
DULL = (-1.5, np.log(0.3), 0.0, 0.0)  # row of gloss at the start: ln β, ln γ, σ, ln ε
START_ERROR = 0.03  # relative model error at the start
LEAST_ERROR_RATIO = 0.7  # smallest ratio of a photograph's median error to that of all
SHADING_SHARE = 1.0 / 3.0  # of the errors by shading that remain: no law of reflection is exact
BOUNCE_DEG = 1.5  # [°] error of directions by interreflections, see `_errors`
IMAGE_AXES = np.array([1.0, -1.0, -1.0])  # x right, y up, z to the camera, from x right, y down, z forward


def calibrate_lamps_from_object(
    photographs: Sequence[str | Path] | Mapping[str, NDArray],
    mask: str | Path | NDArray,
    *,
    camera: Camera | str | Path | None = None,
    transfer: Transfer8 | None = None,
    progress: Progress = silent,
) -> SelfCalibration:
    """Directions and relative strengths of far lamps, each with its error, from the object's own shading.

    photographs: five or more of one view, one lamp each: files, or name → (height, width, channels), linear, NaN where
    clipped. mask: a picture that is white on the object, or an array (height, width). camera: a `Camera` or its file;
    without it the view is orthographic, and lamps have the axes x right, y up, z to the camera. transfer: of 8-bit
    files. The object is assumed to be convex at its outline; its gloss and roughness are fitted too.

    `InputError` where too little of the object shows, the lamps lie in one plane with it, or its surface is flat.
    """
    if len(photographs) == 0:
        raise InputError("no photograph of the object is given: give one per lamp")
    lens = camera if isinstance(camera, Camera) or camera is None else read_camera(camera)
    light = lamp_photographs(photographs, transfer, linear=True)
    start = self_calibrate(light, _inside(mask), lens, progress=part_of(progress, 0.0, 0.5))
    refined = refined_lamps(light, _inside(mask), lens, start, part_of(progress, 0.5, 0.5))
    return replace(refined, perspective=lens is not None)


def _inside(mask: str | Path | NDArray) -> NDArray[np.bool_]:
    """(height, width), true where the mask is brighter than half its brightest value."""
    picture = read_picture(mask) if isinstance(mask, (str, Path)) else np.asarray(mask)
    grey = picture.reshape(*picture.shape[:2], -1)[..., :3].max(axis=2)
    return np.asarray(grey > 0.5 * picture.max(), np.bool_)


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
    usable = used.sum(axis=0) >= max(FEWEST_LAMPS - 1, len(values) // 2)
    on_surface = on_object.copy()
    on_surface[on_object] = usable
    strength = np.log(start.strength.mean(axis=1))
    lamps = start.to_lamp @ turn.T * np.exp(strength - strength.mean())[:, None]
    fit, status = _fitted(values[:, usable], used[:, usable], on_surface, tangent, lamps, progress)
    error, of_strength = _errors(fit, start)
    strengths = np.exp(fit.guess.lamps[:, :1]) * colours(light[:, on_object])
    to_lamp = fit.guess.to_lamp @ turn
    progress(1.0, "")
    return replace(
        start,
        to_lamp=to_lamp,
        strength=strengths / np.median(strengths, axis=0),
        standard_error_deg=error,
        strength_error=of_strength,
        condition=check_spread(to_lamp).condition,
        statuses={**start.statuses, "the joint surface": status},
    )


def _errors(fit: JointSurface, start: SelfCalibration) -> tuple[Array, Array]:
    """(K,) of directions [°] and of ln strength.

    In addition to the curvature of the fit: the shift of the lamps without the prior of few albedos, a share of the
    errors by shading, and the effect of interreflections (6 % of the lamp's light, from below) on simulated objects.
    """
    guess, (turns, strengths) = fit.guess, fit.variance()
    other = _settled(JointSurface(replace(fit.data, few=0.0), guess, fit.prior))[0].guess
    moved = np.degrees(np.arccos(np.clip(np.sum(guess.to_lamp * other.to_lamp, axis=1), -1.0, 1.0)))
    ratio = other.lamps[:, 0] - guess.lamps[:, 0]
    directions = [
        np.degrees(np.sqrt(turns)),
        moved,
        SHADING_SHARE * start.standard_error_deg,
        np.full(len(moved), BOUNCE_DEG),
    ]
    lengths = [np.sqrt(strengths), ratio - np.median(ratio), SHADING_SHARE * start.strength_error]
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
    pixels = np.argwhere(mask)
    place = (pixels - pixels.mean(axis=0))[:, ::-1] * [1.0, -1.0] / np.sqrt(len(pixels) / np.pi)
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
    data, prior = SurfaceData(values / unit, used, place, field, np.full(len(lamps), START_ERROR)), Prior()
    step, status = JointSurface(data, guess, prior), FitStatus(Status.OUT_OF_STEPS, 0)
    for i in range(JOINT_SURFACE_ROUNDS):
        progress(i / (JOINT_SURFACE_ROUNDS + 1), "surface")
        step, status = _settled(JointSurface(replace(data, model_error=_model_error(step)), step.guess, prior))
    progress(JOINT_SURFACE_ROUNDS / (JOINT_SURFACE_ROUNDS + 1), "errors")
    return step, status


def _settled(point: JointSurface) -> tuple[JointSurface, FitStatus]:
    """Steps from `point` until they gain little, and how that ended."""
    tolerance = Tolerance(gain=JOINT_SURFACE_GAIN, least_gain=JOINT_SURFACE_LEAST_GAIN)
    solution = levenberg_marquardt(
        SingleProblem(), point, JOINT_SURFACE_DAMPING, tolerance, JOINT_SURFACE_STEPS, JOINT_SURFACE_TRIALS
    )
    return solution.state, solution.status


def _model_error(step: JointSurface) -> Array:
    """Robust relative error (K,) of the model in each photograph, not far below that of all."""
    data, used = step.data, step.data.used
    relative = np.abs(step.deviation / np.maximum(data.values, data.values.mean(axis=0)))
    free = float(np.sqrt(used.sum() / max(used.sum() - 3.0 * used.shape[1], 1.0)))
    whole = float(np.median(relative[used]))
    each = [
        max(float(np.median(off[own])), LEAST_ERROR_RATIO * whole) if own.any() else whole
        for off, own in zip(relative, used, strict=True)
    ]
    return np.maximum(ROBUST_SCALE * free * np.array(each), SMALLEST_MODEL_ERROR)


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
