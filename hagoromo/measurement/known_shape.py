"""Measure: the reflectance of the materials of a capture whose shape and lamps are known (MODEL §7.3).

Materials by body colour and gloss, then α, β, γ, n and body colour of each by robust least squares; every parameter
with its standard error, its 95 % interval and whether the photographs tell it at all.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.exr import write_exr
from hagoromo.files.png import write_png
from hagoromo.files.whole import whole_folder
from hagoromo.measurement.gloss.gloss_map import gloss_map
from hagoromo.measurement.gloss.gloss_segment import split_by_gloss
from hagoromo.measurement.material.body_map import BodyMap, body_map
from hagoromo.measurement.material.clipped import clipped, with_gloss_untold, without_plateaus
from hagoromo.measurement.material.estimate import estimate_material
from hagoromo.measurement.material.lamp_colour import LampColour, lamp_colour
from hagoromo.measurement.material.segment import interior, segment
from hagoromo.measurement.material.separation import Separation, separated, write_separation
from hagoromo.measurement.observations import known_shape, observations, shape
from hagoromo.measurement.robust_fit import N_RANGE
from hagoromo.photograph.capture import Capture
from hagoromo.photograph.photograph import Photograph
from hagoromo.photograph.pixels import default_channels
from hagoromo.progress import Progress, silent
from hagoromo.reflectance.material.material_estimate import MaterialEstimate
from hagoromo.reflectance.material.materials_file import write_materials

SEED = 0  # of the choice of pixels; the same capture gives the same measurement
FULL_COLOUR = 5.0  # standard deviations at which a residual's picture is fully red or blue


@dataclass(frozen=True, eq=False)
class Measurement:
    """What was measured of a capture.

    materials: by falling number of pixels. labels: (h, w) index into materials, −1 unknown. predicted: per photograph
    (h, w, C) values that the materials give, NaN where they say nothing. residuals: per photograph (h, w, C), values −
    predicted in stated standard deviations, NaN where nothing is predicted or the pixel is invalid. normals: (h, w, 3)
    used. lamp_colour: where it was measured. body: α c_b of every pixel, and its gloss. separation: of the photograph
    with most gloss.
    """

    materials: tuple[MaterialEstimate, ...]
    labels: NDArray[np.integer]
    predicted: tuple[NDArray[np.float32], ...]
    residuals: tuple[NDArray[np.float32], ...]
    normals: NDArray[np.float32]
    lamp_colour: LampColour | None = None
    body: BodyMap | None = None
    separation: Separation | None = None


def measure(
    capture: Capture,
    labels: NDArray[np.integer] | None = None,
    n: float | None = None,
    colour_from_highlights: bool = False,
    progress: Progress = silent,
) -> Measurement:
    """Reflectance of every material of `capture`, whose points and normals are known.

    labels: (h, w) materials 0, 1, …, −1 unknown; found from body colours and gloss when not given. n: refractive index
    where it is known. colour_from_highlights: measure the colour of the lamps, which the capture then does not know;
    without it their spectra and the camera's response are trusted (white is 1 where no response is known).
    Raises `InputError` when the shape or the lamps are missing, no pixel is usable, or a fit does not settle.
    """
    _check(capture, labels, n)
    capture = without_plateaus(capture)
    progress(0.0, "materials")
    labels = split_by_gloss(capture, segment(capture)) if labels is None else np.asarray(labels, np.int64)
    colour = lamp_colour(capture, labels) if colour_from_highlights else None
    numbers = [number for number in np.unique(labels) if number >= 0]
    found: dict[int, MaterialEstimate] = {}
    refused = []
    for i, number in enumerate(numbers):
        progress((i + 1) / (len(numbers) + 2), f"material {i + 1} of {len(numbers)}")
        try:
            found[number] = _material(capture, labels, number, n, colour)
        except InputError as error:
            refused.append(str(error))
    if not found:
        raise InputError("; ".join(refused) or "labels name no material: give a number from 0 on to its pixels")
    for reason in refused:
        warnings.warn(f"{reason}: its pixels stay unknown", stacklevel=2)
    index = np.full(labels.max() + 2, -1)
    index[list(found)] = np.arange(len(found))
    labels, materials = index[np.where(labels >= 0, labels, -1)], tuple(found.values())
    progress((len(numbers) + 1) / (len(numbers) + 2), "residuals")
    white = None if colour is None else colour.value
    materials, gloss = gloss_map(capture, labels, materials, white)
    body = body_map(capture, labels, materials, white, gloss)
    predicted, separation = _parted(capture, body)
    residuals = tuple(_residual(*pair) for pair in zip(capture.photographs, predicted, strict=True))
    normals = np.where(known_shape(capture)[..., None], np.nan_to_num(shape(capture)[1]), 0.0).astype(np.float32)
    progress(1.0, "")
    return Measurement(materials, labels, predicted, residuals, normals, colour, body, separation)


def with_separation(capture: Capture, measurement: Measurement) -> Measurement:
    """`measurement` of `capture`, whose shape is known by now, with the separation of its most glossy photograph."""
    body = body_map(capture, measurement.labels, measurement.materials)
    return replace(measurement, separation=_parted(capture, body)[1])


def write_measurement(measurement: Measurement, folder: str | Path, force: bool = False) -> Path:
    """Write `measurement` to `folder`, whole or not at all; see `fill_measurement`."""
    with whole_folder(folder, force) as home:
        fill_measurement(measurement, home)
    return Path(folder)


def fill_measurement(measurement: Measurement, home: Path) -> None:
    """materials.json, normals.exr, labels.png (0 unknown, 1 the first material, …) and a picture of each residual.

    Where they were found: body.exr (α c_b [1/sr] of every pixel and its standard error), gloss.exr (β [1/sr] and
    γ [rad] of every pixel and theirs) where gloss varies over a material, and the separation of the photograph NN that
    shows most gloss, as `write_separation` has it.
    In residual_NN.png white is what the noise allows, red brighter and blue darker than predicted, full at 5 standard
    deviations; grey is unknown.
    """
    write_materials(measurement.materials, home / "materials.json", force=True)
    axes = zip(("N.X", "N.Y", "N.Z"), np.moveaxis(measurement.normals, 2, 0), strict=True)
    write_exr(home / "normals.exr", dict(axes))
    write_png(home / "labels.png", (measurement.labels + 1).astype(np.uint8))
    for i, residual in enumerate(measurement.residuals):
        write_png(home / f"residual_{i:02d}.png", _picture(residual))
    names = default_channels(measurement.predicted[0].shape[2])
    if measurement.body is not None:
        write_exr(home / "body.exr", measurement.body.channels(names))
        if measurement.body.gloss is not None:
            write_exr(home / "gloss.exr", measurement.body.gloss.channels())
    if measurement.separation is not None:
        write_separation(measurement.separation, names, home)


def _check(capture: Capture, labels: NDArray[np.integer] | None, n: float | None) -> None:
    points, _ = shape(capture)
    if n is not None and not N_RANGE[0] <= n <= N_RANGE[1]:
        raise InputError(f"n is {n}: give a refractive index from {N_RANGE[0]:g} to {N_RANGE[1]:g}")
    for photograph in capture.photographs:
        if not photograph.lamps:
            raise InputError(f"photograph {photograph.name!r} has no lamp: calibrate the lamps first")
        if photograph.values.shape != capture.photographs[0].values.shape:
            raise InputError(f"photograph {photograph.name!r} has another size than the first: give photographs of one")
    if labels is not None and np.shape(labels) != points.shape[:2]:
        raise InputError(f"labels of shape {np.shape(labels)} for photographs of {points.shape[:2]} pixels")
    if not known_shape(capture).any():
        raise InputError(f"capture {capture.name!r} has no pixel with a point and a unit normal: give its shape")


def _material(
    capture: Capture, labels: NDArray[np.integer], number: int, n: float | None, colour: LampColour | None
) -> MaterialEstimate:
    region = known_shape(capture) & interior(labels, number)
    seen = observations(capture, region, None if colour is None else colour.value, SEED)
    error = None if colour is None else colour.relative_covariance
    cut = clipped(capture, region)
    try:
        found = estimate_material(seen, f"material {number + 1}", int(np.sum(labels == number)), n, error)
    except InputError as wrong:
        if cut.hidden > np.sum(seen.used.any(axis=1)):
            raise InputError(f"{wrong}; {cut.hidden} of its values are clipped: expose shorter") from wrong
        raise
    return with_gloss_untold(found, cut)


def _parted(capture: Capture, body: BodyMap) -> tuple[tuple[NDArray[np.float32], ...], Separation]:
    """What the materials predict for each photograph, NaN where none is, and the parts of the one with most gloss."""
    predicted, most, shown = [], -1.0, None
    for number, photograph in enumerate(capture.photographs):
        parts = body.parts(capture, photograph)
        predicted.append(parts.sum.astype(np.float32))
        gloss = float(np.nansum(parts.interface) / max(float(np.nansum(parts.sum)), 1e-300))
        if gloss > most:
            most, shown = gloss, (photograph, parts, number)
    assert shown is not None  # a capture has a photograph
    return tuple(predicted), separated(*shown)


def _residual(photograph: Photograph, predicted: NDArray[np.float32]) -> NDArray[np.float32]:
    """Values − predicted, in stated standard deviations: (h, w, C), NaN where nothing is predicted or valid."""
    known = photograph.mask[..., None] & np.isfinite(predicted)
    deviation = np.where(known, photograph.values - predicted, np.nan)
    return (deviation / np.sqrt(np.where(known, photograph.variance, 1.0))).astype(np.float32)


def _picture(residual: NDArray[np.float32]) -> NDArray[np.uint8]:
    """The mean residual (h, w, C) of the channels: white at 0, red above, blue below, grey where unknown."""
    mean = residual.mean(axis=2)
    strength = np.clip(np.nan_to_num(mean) / FULL_COLOUR, -1.0, 1.0)
    fading = 1.0 - np.abs(strength)
    picture = np.stack([np.where(strength > 0, 1.0, fading), fading, np.where(strength < 0, 1.0, fading)], axis=2)
    return np.rint(255.0 * np.where(np.isnan(mean)[..., None], 0.5, picture)).astype(np.uint8)
