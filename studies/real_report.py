"""Report of the study of real photographs: tables and pictures on one self-contained page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

import hagoromo as hg
from hagoromo_page.report.report_pictures import around
from studies.leave_one_out import NORMAL_METHODS, OURS, YARDSTICK
from studies.object_study import INNER_RADIUS_SHARE, SPHERE, ObjectStudy

FULL_COLOUR_SHARE = 0.25  # of the photograph's 99th percentile: difference that is shown fully red or blue


def write_pictures(study: ObjectStudy, folder: Path) -> None:
    """The pictures of an object as PNG files."""
    folder.mkdir()
    for name, picture in _pictures(study).items():
        hg.write_png(folder / f"{name}.png", picture)


def write_real_report(path: Path, record: Mapping[str, Any], studies: Sequence[ObjectStudy]) -> None:
    """Write the page to `path`."""
    gains = [100.0 * study["gain"] for study in record["objects"].values()]
    keys = list(next(iter(record["response"]["residuals"].values())))
    inner = f"mean within {100 * INNER_RADIUS_SHARE:.0f} % of the radius"
    hg.write_page(
        path,
        "real.html.j2",
        "studies",
        record=record,
        gains=gains,
        better=sum(gain > 0 for gain in gains),
        lamp_head=("lamp", "x", "y", "z", "standard error", *_readings_of_others(record)),
        lamp_rows=_lamp_rows(record),
        response_head=("object", *(_hypothesis(key) for key in keys), "best exponent"),
        response_rows=_response_rows(record["response"], keys),
        score_head=("method", *record["objects"]),
        score_rows=_score_rows(record),
        sphere=SPHERE,
        normal_head=("method", "mean", "median", inner, "pixels"),
        normal_rows=_normal_rows(record),
        full_colour=100 * FULL_COLOUR_SHARE,
        objects=[_object(study) for study in studies],
    )


def _readings_of_others(record: Mapping[str, Any]) -> list[str]:
    return [f"angle to the reading by the {who}" for who in record["lamps"][0]["off_their_reading_deg"]]


def _lamp_rows(record: Mapping[str, Any]) -> list[list[str]]:
    return [
        [lamp["name"], *(f"{x:.4f}" for x in lamp["to_lamp"]), f"{lamp['standard_error_deg']:.2f}°",
         *(f"{angle:.2f}°" for angle in lamp["off_their_reading_deg"].values())]
        for lamp in record["lamps"]
    ]  # fmt: skip


def _hypothesis(key: str) -> str:
    return key if key == "sRGB" else Markup("light = v<sup>{}</sup>").format(key)


def _response_rows(response: Mapping[str, Any], keys: Sequence[str]) -> list[list[str]]:
    return [
        [name, *(f"{100 * of[key]:.2f}" for key in keys), f"{response['exponents'][name]:.2f}"]
        for name, of in response["residuals"].items()
    ]


def _score_rows(record: Mapping[str, Any]) -> list[list[str]]:
    rows = []
    for method, text in NORMAL_METHODS.items():
        name = Markup("<b>{}</b>").format(text) if method in (YARDSTICK, OURS) else text
        means = [study["mean"][method] for study in record["objects"].values()]
        rows.append([name, *(f"{100 * m['relative_rmse']:.1f} · {m['psnr']:.1f}" for m in means)])
    gains = [f"{100 * study['gain']:.0f} %" for study in record["objects"].values()]
    return [*rows, [Markup("<b>gain over plain least squares</b>"), *gains]]


def _normal_rows(record: Mapping[str, Any]) -> list[list[str]]:
    errors = record["objects"].get(SPHERE, {}).get("normal_errors_deg") or {}
    columns = ("mean", "median", "mean_inner")
    return [[name, *(f"{e[key]:.2f}°" for key in columns), str(e["pixels"])] for name, e in errors.items()]


def _object(study: ObjectStudy) -> dict[str, Any]:
    crop = around(study.shown.photograph.mask)
    pictures = {name: picture[crop] for name, picture in _pictures(study).items()}
    ours, yardstick = (100 * study.scores[method][:, 0].mean() for method in (OURS, YARDSTICK))
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
    return {
        "name": study.name,
        "ours": ours,
        "yardstick": yardstick,
        "pictures": [
            hg.page_picture(pictures[name], f"{study.name}: {title}", title) for name, title in titles.items()
        ],
        "rows": [
            [m.name, str(m.pixels), f"{m.alpha:.3f}", *(_with_error(m, key) for key in ("beta", "gamma"))]
            for m in study.measurement.materials
        ],
        "remarks": [f"{m.name}: {remark}" for m in study.measurement.materials for remark in m.remarks],
    }


def _with_error(material: Any, key: str) -> str:
    note = "" if material.identifiable[key] else Markup(' <span class="no">not identifiable</span>')
    return Markup("{:.3f} ± {:.3f}").format(getattr(material, key), material.standard_error[key]) + note


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
    strength = np.where(inside, np.clip(difference / FULL_COLOUR_SHARE, -1.0, 1.0), 0.0)
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
