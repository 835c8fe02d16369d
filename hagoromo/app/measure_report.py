"""Report of a measurement: the materials of a capture with their uncertainty, and what they leave unexplained."""

from __future__ import annotations

import math
from html import escape
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hagoromo import __version__
from hagoromo.app.display import exposure
from hagoromo.app.gloss_plot import gloss_plot
from hagoromo.app.page import Page, image
from hagoromo.light.colour import srgb_encode
from hagoromo.measurement.gloss.gloss_map import GlossMap
from hagoromo.measurement.known_shape import Measurement
from hagoromo.measurement.material.separation import Separation
from hagoromo.photograph.capture import Capture
from hagoromo.photograph.photograph import Photograph
from hagoromo.reflectance.material.material_estimate import PARAMETERS, MaterialEstimate
from hagoromo_figures.demo.report_pictures import around, developed, residual

SYMBOLS = {"alpha": "α [1/sr]", "beta": "β [1/sr]", "gamma": "γ [rad]", "n": "n"}


def write_measure_report(path: Path, capture: Capture, measurement: Measurement) -> None:
    """Write the page to `path`: one self-contained HTML file."""
    photographs = len(capture.photographs)
    lead = f"{photographs} photographs of {escape(capture.name or 'an object')}, measured by Hagoromo {__version__}."
    page = Page("Measured reflectance", lead)
    page.section(
        "Materials",
        "Weight α and colour of the body, weight β, facet width γ and refractive index n of the interface, in the "
        "dichromatic Torrance–Sparrow model. A parameter that the photographs cannot tell is marked: its value is a "
        "choice that the remarks below the table name.",
    )
    head = ("material", "pixels", "parameter", "measured", "standard error", "95 % interval", "told")
    table = [row for material in measurement.materials for row in _rows(material)]
    page.table("Parameters, each with its uncertainty.", head, table, group=len(PARAMETERS))
    remarks = [f"{escape(m.name)}: {escape(remark)}" for m in measurement.materials for remark in m.remarks]
    if remarks:
        page.bullets(remarks)
    crop = around(measurement.labels >= 0)
    if measurement.separation is not None:
        _separation(page, capture, measurement.separation, crop)
    if measurement.body is not None and measurement.body.gloss is not None:
        _gloss(page, measurement.body.gloss, crop)
    page.section("Photographs, prediction and residual")
    for photograph, predicted, left in zip(
        capture.photographs, measurement.predicted, measurement.residuals, strict=True
    ):
        page.figure(
            f"{escape(photograph.name)}: photograph, prediction by the measured materials, and residual (white where "
            "noise explains it, red brighter and blue darker than predicted, full colour at 5 standard deviations).",
            image(_shown(photograph, photograph.values)[crop], "photograph"),
            image(_shown(photograph, predicted)[crop], "predicted"),
            image(residual(left)[crop], "residual", lossless=True),
        )
    path.write_text(page.html(), encoding="utf-8")


def _separation(page: Page, capture: Capture, parts: Separation, crop: tuple[slice, slice]) -> None:
    photograph = capture.photographs[parts.number]
    page.section(
        "Body and interface",
        "The photograph that shows most gloss, parted by colour and by the measured materials, joined by their errors; "
        "the two parts sum to the photograph.",
    )
    page.figure(
        f"{escape(photograph.name)}: photograph, what the bodies send back, and what the interfaces reflect.",
        image(_shown(photograph, photograph.values)[crop], "photograph"),
        image(_shown(photograph, np.nan_to_num(parts.body))[crop], "body"),
        image(_shown(photograph, np.nan_to_num(parts.interface))[crop], "interface"),
    )


def _gloss(page: Page, of: GlossMap, crop: tuple[slice, slice]) -> None:
    page.section(
        "Gloss over the surface",
        "The gloss varies over a material more than noise makes it, so β and γ were measured pixel by pixel. A pixel "
        "that no lamp shows near its highlight has its material's middle, and the spread over the material as its "
        "error. gloss.exr has the maps.",
    )
    page.figure("β and γ of every pixel above, the standard error of each over its value below.", gloss_plot(of, crop))


def _rows(material: MaterialEstimate) -> list[list[str]]:
    rows = []
    for key in PARAMETERS:
        error, digits = material.standard_error[key], _digits(material.standard_error[key])
        low, high = (f"{bound:.{digits}f}" for bound in material.interval_95[key])
        told = "yes" if material.identifiable[key] else '<span class="no">no</span>'
        figures = [f"{getattr(material, key):.{digits}f}", "" if error is None else f"{error:.{digits}f}"]
        rows.append([escape(material.name), str(material.pixels), SYMBOLS[key], *figures, f"{low} … {high}", told])
    return rows


def _digits(error: float | tuple[float, ...] | None) -> int:
    """Decimals that show an error with two significant figures; three where there is none."""
    if not isinstance(error, float) or not 0.0 < error < math.inf:
        return 3
    return max(0, 1 - math.floor(math.log10(error)))


def _shown(photograph: Photograph, values: NDArray) -> NDArray[np.uint8]:
    """`values` as people see them; as they are, under a display curve, where the camera's response is unknown."""
    if photograph.camera.response is not None and photograph.values.shape[2] == 3:
        return developed(photograph, values)
    grey = photograph.values.mean(axis=2, keepdims=True)
    shown = values if values.shape[2] == 3 else np.repeat(values.mean(axis=2, keepdims=True), 3, axis=2)
    return srgb_encode(np.nan_to_num(shown) * exposure(grey))
