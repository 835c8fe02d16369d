"""Report of the study of real photographs: tables and pictures on one self-contained page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.app.page import Page, image
from hagoromo.files.png import write_png
from hagoromo_figures.demo.report_pictures import around
from studies.leave_one_out import METHODS, OURS, YARDSTICK
from studies.object_study import INNER, SPHERE, ObjectStudy

FULL_COLOUR = 0.25  # of the photograph's 99th percentile: difference that is shown fully red or blue


def write_pictures(study: ObjectStudy, folder: Path) -> None:
    """The pictures of an object as PNG files."""
    folder.mkdir()
    for name, picture in _pictures(study).items():
        write_png(folder / f"{name}.png", picture)


def write_real_report(path: Path, record: Mapping[str, Any], studies: Sequence[ObjectStudy]) -> None:
    """Write the page to `path`."""
    page = Page("Real photographs", f"Six objects under twelve lamps, measured by Hagoromo {record['hagoromo']}.")
    for part in (_summary, _lamps, _response, _predictions, _normals):
        part(page, record)
    for study in studies:
        _object(page, study)
    _limits(page)
    path.write_text(page.html(), encoding="utf-8")


def _summary(page: Page, record: Mapping[str, Any]) -> None:
    gains = [100.0 * found["gain"] for found in record["objects"].values()]
    page.section(
        "What this is",
        "The photometric-stereo set of the University of Washington: 8-bit photographs of six objects, one lamp of "
        "twelve lit in each, and of a chrome ball that shows where the lamps stand. Every photograph is predicted from "
        "the eleven others, normals and reflectance solved anew without it, by plain least squares of Lambert's law "
        f"and by Hagoromo. Hagoromo's relative error is lower on {sum(g > 0 for g in gains)} of {len(gains)} objects, "
        f"by {min(gains):.0f} to {max(gains):.0f} %.",
    )


def _lamps(page: Page, record: Mapping[str, Any]) -> None:
    page.section(
        "Lamps",
        "Read off the chrome ball: the mask's circle, the centroid of the highlight, the mirrored line of sight. Two "
        "readings by others come with the set; they differ from each other by up to 8°.",
    )
    rows = [
        [lamp["name"], *(f"{x:.4f}" for x in lamp["to_lamp"]), f"{lamp['standard_error_deg']:.2f}°",
         *(f"{angle:.2f}°" for angle in lamp["off_their_reading_deg"].values())]
        for lamp in record["lamps"]
    ]  # fmt: skip
    others = [f"off the reading by the {who}" for who in record["lamps"][0]["off_their_reading_deg"]]
    page.table("Directions to the lamps.", ("lamp", "x", "y", "z", "standard error", *others), rows)


def _response(page: Page, record: Mapping[str, Any]) -> None:
    found = record["response"]
    error = "" if found["standard_error"] is None else f" ± {found['standard_error']:.2f} (standard error)"
    page.section(
        "Is the response linear?",
        "The set does not say. Each hypothesis decodes the photographs before everything is fitted; what is left "
        f"unexplained is compared. The exponents that the objects ask for have a mean of {found['mean']:.2f}{error}, "
        "1 being linear; sRGB explains none better. The photographs are taken for linear.",
    )
    keys = list(next(iter(found["residuals"].values())))
    rows = [
        [name, *(f"{100 * of[key]:.2f}" for key in keys), f"{found['exponents'][name]:.2f}"]
        for name, of in found["residuals"].items()
    ]
    head = ("object", *(key if key == "sRGB" else f"light = v<sup>{key}</sup>" for key in keys), "best exponent")
    page.table("Median residual [% of the recorded value] under each hypothesis.", head, rows)


def _predictions(page: Page, record: Mapping[str, Any]) -> None:
    page.section(
        "Photographs predicted",
        "Mean over the twelve lamps kept aside in turn. All valid, unsaturated pixels of the object count, those in "
        "cast shadow too. How unevenly the lamps light the field of view is told by the five other objects. The last "
        "line of each group adds what model and photographs disagreed on under the neighbouring lamps, interpolated "
        "over their directions; done to Lambert's law too, it shows what the model itself is worth.",
    )
    rows = []
    for method, text in METHODS.items():
        name = f"<b>{text}</b>" if method in (YARDSTICK, OURS) else text
        means = [found["mean"][method] for found in record["objects"].values()]
        rows.append([name, *(f"{100 * m['relative_rmse']:.1f} · {m['psnr']:.1f}" for m in means)])
    rows.append(
        ["<b>gain over plain least squares</b>", *(f"{100 * o['gain']:.0f} %" for o in record["objects"].values())]
    )
    page.table("Relative RMSE [%] · PSNR [dB, peak 255].", ("method", *record["objects"]), rows)


def _normals(page: Page, record: Mapping[str, Any]) -> None:
    errors = record["objects"].get(SPHERE, {}).get("normal_errors_deg")
    if errors:
        page.section("Normals", f"<i>{SPHERE}</i> is a sphere: its normals follow from the circle of its mask.")
        columns = ("mean", "median", "mean_inner")
        rows = [[name, *(f"{e[key]:.2f}°" for key in columns), str(e["pixels"])] for name, e in errors.items()]
        inner = f"mean within {100 * INNER:.0f} % of the radius"
        page.table("Error of the sphere's normals.", ("method", "mean", "median", inner, "pixels"), rows)


def _object(page: Page, study: ObjectStudy) -> None:
    crop = around(study.shown.photograph.mask)
    pictures = {name: picture[crop] for name, picture in _pictures(study).items()}
    ours, yardstick = (100 * study.scores[method][:, 0].mean() for method in (OURS, YARDSTICK))
    page.section(study.name.capitalize(), f"Relative RMSE {ours:.1f} %, plain least squares {yardstick:.1f} %.")
    titles = {
        "photograph": f"photograph, lamp {study.shown.lamp}",
        "prediction": "predicted without it",
        "relief": f"volume boxes rendered: {100 * study.relief_score[0]:.1f} %",
        "least_squares": "plain least squares",
        "difference": "prediction − photograph",
        "difference_least_squares": "least squares − photograph",
        "normals": "normals",
        "surface": "surface, lit from the upper left",
    }
    shown = [image(pictures[name], title) for name, title in titles.items()]
    page.figure("The lamp kept aside whose error is in the middle of the twelve.", *shown[:4])
    page.figure(
        f"Differences: red too bright, blue too dark, full colour at {100 * FULL_COLOUR:.0f} % of white; normals as "
        "colours (x red, y green, z blue); the integrated surface.",
        *shown[4:],
    )
    rows = [
        [m.name, str(m.pixels), f"{m.alpha:.3f}", *(_with_error(m, key) for key in ("beta", "gamma"))]
        for m in study.measurement.materials
    ]
    page.table("Materials; α, β relative to the lamps' strength.", ("material", "pixels", "α", "β", "γ [rad]"), rows)
    page.bullets([f"{m.name}: {remark}" for m in study.measurement.materials for remark in m.remarks])


def _limits(page: Page) -> None:
    page.section("Limits")
    page.bullets(
        [
            "Light that one part of an object throws onto another is not modelled: in folds and between legs the model "
            "alone is no better than least squares, and the neighbours' disagreement carries the prediction.",
            "The strength of the lamps is unknown, so albedos are relative; n is not told by lamps on the eye's side.",
            "Lamps that stand apart from the others are extrapolated to and predicted worst.",
            "The camera is unknown and taken to look on from afar.",
        ]
    )


def _with_error(material: Any, key: str) -> str:
    told = "" if material.identifiable[key] else ' <span class="no">not told</span>'
    return f"{getattr(material, key):.3f} ± {material.standard_error[key]:.3f}{told}"


def _pictures(study: ObjectStudy) -> dict[str, NDArray[np.uint8]]:
    """8-bit pictures, linear as the set's own photographs are."""
    shown = study.shown
    true, inside = shown.photograph.values, shown.photograph.mask
    white = float(np.percentile(true[inside], 99))
    ours, plain = shown.predictions[OURS], shown.predictions[YARDSTICK]
    return {
        "photograph": _eight_bit(np.where(inside[..., None], true, 0.0)),
        "prediction": _eight_bit(ours),
        "relief": _eight_bit(study.relief),
        "least_squares": _eight_bit(plain),
        "difference": _signed((ours - true).mean(axis=2) / white, inside),
        "difference_least_squares": _signed((plain - true).mean(axis=2) / white, inside),
        "normals": _eight_bit(np.where(inside[..., None], 0.5 + 0.5 * study.measurement.normals, 1.0)),
        "surface": _surface(shown.points, inside),
    }


def _signed(difference: NDArray[np.floating], inside: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """White at 0, red above, blue below, white outside."""
    strength = np.where(inside, np.clip(difference / FULL_COLOUR, -1.0, 1.0), 0.0)
    fading = 1.0 - np.abs(strength)
    return _eight_bit(
        np.stack([np.where(strength > 0, 1.0, fading), fading, np.where(strength < 0, 1.0, fading)], axis=2)
    )


def _surface(points: NDArray[np.floating], inside: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """The integrated surface as matte plaster lit from the upper left."""
    dx, dy = (np.gradient(points.astype(np.float64), axis=axis) for axis in (1, 0))
    normals = np.cross(dy, dx)
    normals /= np.maximum(np.linalg.norm(normals, axis=2, keepdims=True), 1e-12)
    light = np.clip(normals @ (np.array([-0.5, 0.5, 0.7]) / np.linalg.norm([-0.5, 0.5, 0.7])), 0.0, 1.0)
    return _eight_bit(np.repeat(np.where(inside, 0.9 * light, 1.0)[..., None], 3, axis=2))


def _eight_bit(values: NDArray[np.floating]) -> NDArray[np.uint8]:
    return np.rint(255.0 * np.clip(values, 0.0, 1.0)).astype(np.uint8)
