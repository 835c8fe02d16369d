"""Report of the demo as one self-contained HTML page."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from hagoromo.app.display import exposure, shown
from hagoromo.app.report.page import page_drawing, page_picture, write_page
from hagoromo.camera.response import Response
from hagoromo.camera.srgb_from_camera import srgb_from_camera
from hagoromo.image.image import Image
from hagoromo.light.spectrum import Spectrum
from hagoromo.measurement.measurement import Measurement
from hagoromo.photograph.capture import Capture
from hagoromo.photograph.photograph import Photograph
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo_figures.demo.figures import PAPER_FIGURES
from hagoromo_figures.demo.measurement import Row
from hagoromo_figures.demo.plots import measured_against_true, residual_histogram, spectra
from hagoromo_figures.demo.relit import RIM_PX, Relit
from hagoromo_figures.demo.report_pictures import around, developed, fitted_residuals, labels, residual, response_of
from hagoromo_figures.demo.samples import ISO, RADIUS, ROW_DISTANCE

SYMBOLS = {"alpha": "α [1/sr]", "beta": "β [1/sr]", "gamma": "γ [rad]", "n": "n"}
OTHER_CAMERA, OTHER_LAMP = "Nikon 5100 (NPL)", "A"


@dataclass(frozen=True, eq=False)
class Report:
    """Results of the demo. record: results.json; capture: the measured photographs; aside: the held-out one."""

    record: Mapping[str, Any]
    capture: Capture
    aside: Photograph
    measurement: Measurement
    table: Sequence[Row]
    truth: Mapping[str, Reflectance]
    found: Mapping[str, Reflectance]
    relit: Relit
    figures: Mapping[str, Image]


def write_report(path: Path, report: Report) -> None:
    """Write the page to `path`."""
    used = fitted_residuals(report.capture, report.measurement)
    crop = around(report.relit.mask)
    write_page(
        path,
        "demo.html.j2",
        __package__ or "hagoromo_figures.demo",
        record=report.record,
        view=report.relit,
        camera=report.capture.photographs[0].camera,
        radius=RADIUS,
        distance=ROW_DISTANCE,
        iso=ISO,
        rim=RIM_PX,
        materials=len(report.measurement.materials),
        photographs=[
            page_picture(developed(taken)[crop], f"photograph, lamp {taken.name}", f"lamp {taken.name}")
            for taken in (*report.capture.photographs, report.aside)
        ],
        rows=[_table_row(row) for row in report.table],
        remarks=[f"{m.name}: {remark}" for m in report.measurement.materials for remark in m.remarks],
        errors=page_drawing(measured_against_true(report.table), "Relative error and 95 % interval of each parameter"),
        spectra=page_drawing(_spectra(report), "Body albedo of each material over the wavelength, true and recovered"),
        residuals=_residuals(report, crop),
        histogram=page_drawing(residual_histogram(used), "Histogram of the residuals beside the normal distribution"),
        spread=np.std(np.clip(used, -6, 6)),
        beyond=np.mean(np.abs(used) > 3),
        relit=_relit(report.relit, crop),
        differences=_differences(report.relit),
        figures=[_figure(name, found) for name, found in report.figures.items()],
        other=_other_light(report),
        settings=_settings(report.record),
        times=_times(report.record),
    )


def _spectra(report: Report) -> str:
    true, estimated = (
        {name: r.body_colour.scaled(math.pi * r.alpha) for name, r in reflectances.items()}
        for reflectances in (report.truth, report.found)
    )
    return spectra(true, estimated)


def _residuals(report: Report, crop: tuple[slice, slice]) -> list[Markup]:
    measurement, pictures = report.measurement, []
    for taken, predicted, left in zip(
        report.capture.photographs, measurement.predicted, measurement.residuals, strict=True
    ):
        for what, picture in (("prediction", developed(taken, predicted)), ("residual", residual(left))):
            title = f"{what}, lamp {taken.name}"
            pictures.append(page_picture(picture[crop], title, title, lossless=what == "residual"))
    return [*pictures, page_picture(labels(measurement)[crop], "map of the materials", "materials", lossless=True)]


def _relit(view: Relit, crop: tuple[slice, slice]) -> list[Markup]:
    titles = {"photograph": "photograph", "predicted": "prediction", "difference": "prediction − photograph, × 10"}
    pictures = view.pictures()
    return [page_picture(pictures[key][crop], title, title) for key, title in titles.items()]


def _differences(view: Relit) -> list[list[str]]:
    return [
        [name, f"{d['psnr']:.2f}", f"{d['ssim']:.4f}", f"{d['delta_e_2000']:.2f}", f"{100 * d['relative_rmse']:.2f} %"]
        for name, d in (("measured reflectances", view.measured), ("true reflectances", view.ideal))
    ]


def _figure(name: str, rendered: Image) -> dict[str, Any]:
    picture, shot = rendered.display(), PAPER_FIGURES[name]
    height, width = picture.shape[:2]
    return {
        "picture": page_picture(picture, shot.caption),
        "caption": shot.caption,
        "number": name.split("_")[1],
        "width": width,
        "height": height,
    }


def _other_light(report: Report) -> dict[str, Any]:
    name = list(report.figures)[-1]
    whole = report.figures[name]
    daylight, warm = whole.palette.lamps, [Spectrum.named(OTHER_LAMP)] * len(whole.palette.lamps)
    canon, nikon = response_of(report.aside), Response.load(OTHER_CAMERA)
    views = [
        ("Canon, daylight", canon, daylight, daylight),
        ("Canon set to daylight, incandescent light", canon, warm, daylight),
        ("Nikon set to incandescent light, incandescent light", nikon, warm, warm),
    ]
    pictures = []
    for title, response, lamps, balance in views:
        matrix, values = srgb_from_camera(response, balance[0]), whole.expose(response, lamps)
        pictures.append(page_picture(shown(values, matrix, exposure(values @ matrix.T, whole.alpha)), title, title))
    return {"name": name, "pictures": pictures}


def _settings(record: Mapping[str, Any]) -> list[list[str]]:
    rows = [["size", record["size"]["name"]], ["seed", str(record["size"]["seed"])], ["backend", record["backend"]]]
    versions = [[name, number] for name, number in record["versions"].items()]
    return [*rows, ["hagoromo", record["hagoromo"]], *versions]


def _times(record: Mapping[str, Any]) -> list[list[str]]:
    times = [[name, f"{value:.1f}"] for name, value in record["seconds"].items()]
    return [*times, ["sum", f"{sum(record['seconds'].values()):.1f}"]]


def _table_row(row: Row) -> list[Any]:
    """Cells of Table 1, with as many digits as the interval justifies."""
    symbol = SYMBOLS.get(row.parameter, Markup("c<sub>{}</sub>").format(row.parameter[-1]))
    closed = math.isfinite(row.high) and row.high > row.low
    digits = min(max(1 - math.floor(math.log10(0.5 * (row.high - row.low))), 2), 6) if closed else 3
    interval = f"{row.low:.{digits}f} … {row.high:.{digits}f}" if closed else "open"
    holds = ("yes" if row.inside else Markup('<span class="no">no</span>')) if row.identifiable else "–"
    first = row.material if row.parameter == "alpha" else ""
    identifiable = "yes" if row.identifiable else "no"
    return [first, symbol, f"{row.true:.{digits}f}", f"{row.estimate:.{digits}f}", interval, identifiable, holds]
