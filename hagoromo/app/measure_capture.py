"""Measure a capture folder: materials, normals, labels, residuals and a report, with or without known shape."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hagoromo.app.body_spectra import write_body_spectra
from hagoromo.app.measure_large import large_source, solve_large, write_fine
from hagoromo.app.measure_report import write_measure_report
from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError
from hagoromo.files.exr import write_exr
from hagoromo.files.whole import whole_folder
from hagoromo.measurement.known_shape import Measurement, fill_measurement, measure, with_separation
from hagoromo.measurement.normals.gloss_estimate import measurement_of
from hagoromo.measurement.normals.normals import solve_normals
from hagoromo.measurement.surface.depth import surface_from_normals
from hagoromo.measurement.surface.shape import has_near_lamps, solve_shape
from hagoromo.photograph.capture import Capture, load_capture
from hagoromo.photograph.stillness import moved
from hagoromo.progress import Progress, silent


@dataclass(frozen=True)
class Known:
    """What the user knows beside the capture: refractive index n, distance [m] of an object of unknown shape."""

    n: float | None = None
    distance: float | None = None


def measure_capture(
    folder: str | Path,
    out: str | Path,
    known: Known | None = None,
    force: bool = False,
    progress: Progress = silent,
) -> Measurement:
    """Measure the capture in `folder` and write the result to the folder `out`, whole or not at all.

    With points and normals: `measure`. Without them: normals from four lamps or more, gloss and pixels' body colours
    with them (`solve_normals`), and points.exr, integrated at the object's distance (None: the camera's from the
    world's origin; under near lamps it is where the search for the true one begins). Photographs too large for the
    memory are read one at a time and solved in tiles; residuals are then those of pixel means.
    `InputError` for a capture that can be measured neither way.
    """
    known = known or Known()
    with whole_folder(out, force) as home:
        source = large_source(folder)
        if source is None:
            return fill_measured(load_capture(folder), home, known, progress)
        distance = _distance(source.photograph(0).camera, known)
        measured, capture, fine = solve_large(source, home, distance, progress)
        fill_measurement(measured, home)
        write_body_spectra(home / "body_spectra.json", capture, measured)
        write_measure_report(home / "report.html", capture, measured)
        write_fine(fine, home)
        return measured


def fill_measured(capture: Capture, home: Path, known: Known, progress: Progress = silent) -> Measurement:
    """Measure `capture` and write the result to the folder `home`; see `measure_capture`.

    points.exr is the shape, given or solved; where it was solved, body.exr holds the α c_b of each pixel, variance.exr
    that of the normals' direction [rad²] and of the points' distance [m²].
    Photographs that moved are told in a warning.
    """
    for name, (x, y) in moved(capture.photographs).items():
        warnings.warn(
            f"{name} stands ({x:.1f}, {y:.1f}) px from the other photographs: take it again, or leave it out",
            stacklevel=2,
        )
    if capture.points is not None and capture.normals is not None:
        measured = measure(capture, n=known.n, progress=progress)
    else:
        measured, capture, body, variance = _of_unknown_shape(capture, known, progress)
        write_exr(home / "variance.exr", variance)
        measured = with_separation(capture, measured)
        channels = "RGB" if body.shape[2] == 3 else map(str, range(body.shape[2]))
        write_exr(home / "body.exr", dict(zip(channels, np.moveaxis(body, 2, 0), strict=True)))
    points = np.moveaxis(np.asarray(capture.points), 2, 0)
    write_exr(home / "points.exr", dict(zip(("P.X", "P.Y", "P.Z"), points, strict=True)))
    fill_measurement(measured, home)
    write_body_spectra(home / "body_spectra.json", capture, measured)
    write_measure_report(home / "report.html", capture, measured)
    return measured


def _of_unknown_shape(
    capture: Capture, known: Known, progress: Progress
) -> tuple[Measurement, Capture, NDArray[np.float32], dict[str, NDArray[np.float32]]]:
    """The measurement, the capture with the shape solved, the bodies (h, w, C), the variances of the shape (h, w)."""
    camera = capture.photographs[0].camera
    away = _distance(camera, known)
    if has_near_lamps(capture):
        shape = solve_shape(capture, away, progress=progress)
        fit, surface = shape.found, shape.surface
    else:
        fit = solve_normals(capture, progress=progress)
        surface = surface_from_normals(fit.normals, camera, away, fit.variance)
    measured = measurement_of(capture, fit)
    variance = {"normal": fit.variance, "distance": surface.variance}
    return measured, replace(capture, points=surface.points, normals=fit.normals), fit.body, variance


def _distance(camera: Camera, known: Known) -> float:
    """About, to the surface [m]; `InputError` where nothing tells, or n is given for a shape that is not known."""
    away = float(np.linalg.norm(camera.position)) if known.distance is None else known.distance
    if away == 0.0:
        raise InputError("the camera stands at the world's origin and the capture has no shape: give --distance")
    if known.n is not None:
        raise InputError("lamps that solve the normals do not tell what n changes: leave --n out, or give the shape")
    return away
