"""The parts of the demo's page that say what was measured: the samples to relight, findings in words, figures."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from markupsafe import Markup

from hagoromo.measurement.measurement import Measurement
from hagoromo.photograph.capture import Capture
from hagoromo.photograph.photograph import Photograph
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo_matter.demo.measurement import ParameterRow
from hagoromo_matter.demo.plots import SYMBOLS, measured_against_true, residual_histogram, spectra
from hagoromo_matter.demo.relit import RIM_PX, Relit
from hagoromo_matter.demo.samples import ISO, RADIUS, ROW_DISTANCE
from hagoromo_matter.demo.size import Size
from hagoromo_page.publication.object_page import single_page
from hagoromo_page.publication.publish import page_source
from hagoromo_page.report.findings import findings, missing
from hagoromo_page.report.page import page_drawing, page_picture, page_text, page_viewer
from hagoromo_page.report.report_pictures import around, developed, fitted_residuals, labels, residual

VIEWER_BYTES = 1_700_000  # of the samples to relight
PACKAGE = "hagoromo_matter.demo"


@dataclass(frozen=True, eq=False)
class MeasurementResults:
    """Results of the measurement. record: of results.json; capture: the measured photographs; aside: the one kept."""

    record: Mapping[str, Any]
    size: Size
    capture: Capture
    aside: Photograph
    measurement: Measurement
    table: Sequence[ParameterRow]
    truth: Mapping[str, Reflectance]
    found: Mapping[str, Reflectance]
    relit: Relit


def measured_parts(known: MeasurementResults) -> dict[str, str]:
    """HTML: "head" of the page, "samples" to relight, "found" in words, and "details" of the measurement."""
    viewer = page_viewer(single_page(page_source(known.measurement, None), VIEWER_BYTES).viewer)
    pixels = sum(material.pixels for material in known.measurement.materials)
    said = [findings(material, pixels) for material in known.measurement.materials]
    words = page_text(
        "demo_found.html.j2", PACKAGE, findings=said, missing=missing(said), held=known.record["coverage"],
        view=known.relit,
    )  # fmt: skip
    parts = {"head": viewer["viewer_head"], "samples": viewer["viewer"], "found": words, "details": _details(known)}
    return {name: str(html) for name, html in parts.items()}


def _details(known: MeasurementResults) -> str:
    used = fitted_residuals(known.capture, known.measurement)
    crop = around(known.relit.mask)
    return page_text(
        "demo_details.html.j2",
        PACKAGE,
        before=len(known.size.figures) + 1,
        record=known.record,
        size=known.size,
        view=known.relit,
        camera=known.capture.photographs[0].camera,
        radius=RADIUS,
        distance=ROW_DISTANCE,
        iso=ISO,
        rim=RIM_PX,
        materials=len(known.measurement.materials),
        photographs=[
            page_picture(developed(taken)[crop], f"photograph, lamp {taken.name}", f"lamp {taken.name}")
            for taken in (*known.capture.photographs, known.aside)
        ],
        rows=[_table_row(row) for row in known.table],
        remarks=[f"{m.name}: {remark}" for m in known.measurement.materials for remark in m.remarks],
        errors=page_drawing(measured_against_true(known.table), "Relative error and 95 % interval of each parameter"),
        spectra=page_drawing(_spectra(known), "Body albedo of each material over the wavelength, true and recovered"),
        residuals=_residuals(known, crop),
        histogram=page_drawing(residual_histogram(used), "Histogram of the residuals beside the normal distribution"),
        spread=np.std(np.clip(used, -6, 6)),
        beyond=np.mean(np.abs(used) > 3),
        relit=_relit(known.relit, crop),
        differences=_differences(known.relit),
    )


def _spectra(known: MeasurementResults) -> str:
    true, estimated = (
        {name: r.body_colour.scaled(math.pi * r.alpha) for name, r in reflectances.items()}
        for reflectances in (known.truth, known.found)
    )
    return spectra(true, estimated)


def _residuals(known: MeasurementResults, crop: tuple[slice, slice]) -> list[Markup]:
    measurement, pictures = known.measurement, []
    for taken, predicted, left in zip(
        known.capture.photographs, measurement.predicted, measurement.residuals, strict=True
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


def _table_row(row: ParameterRow) -> list[Any]:
    """Cells of Table 1, with as many digits as the interval justifies."""
    symbol = SYMBOLS.get(row.parameter, Markup("c<sub>{}</sub>").format(row.parameter[-1]))
    closed = math.isfinite(row.high) and row.high > row.low
    digits = min(max(1 - math.floor(math.log10(0.5 * (row.high - row.low))), 2), 6) if closed else 3
    interval = f"{row.low:.{digits}f} … {row.high:.{digits}f}" if closed else "open"
    holds = ("yes" if row.inside else Markup('<span class="no">no</span>')) if row.identifiable else "–"
    first = row.material if row.parameter == "alpha" else ""
    identifiable = "yes" if row.identifiable else "no"
    return [first, symbol, f"{row.true:.{digits}f}", f"{row.estimate:.{digits}f}", interval, identifiable, holds]
