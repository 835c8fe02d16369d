"""Report of a measurement: the materials of a capture with their uncertainty, and what they leave unexplained."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.app.display import exposure
from hagoromo.app.gloss_plot import gloss_plot
from hagoromo.app.report.page import page_drawing, page_picture, write_page
from hagoromo.errors import InputError
from hagoromo.light.colour import srgb_encode
from hagoromo.measurement.material.separation import Separation
from hagoromo.measurement.measurement import Measurement
from hagoromo.photograph.capture import Capture
from hagoromo.photograph.photograph import Photograph
from hagoromo.reflectance.material.material_html import PARAMETER_SYMBOLS, PARAMETER_TITLES, parameter_rows
from hagoromo_figures.demo.report_pictures import around, developed, residual


def write_measure_report(path: Path, measurement: Measurement) -> None:
    """Write the page to `path`: one self-contained HTML file. `InputError` for a measurement without photographs."""
    capture, gloss = measurement.capture, measurement.gloss
    if capture is None:
        raise InputError("the measurement has no photographs, as it was loaded from its files: measure again")
    crop = around(measurement.labels >= 0)
    write_page(
        path,
        "measure.html.j2",
        name=capture.name,
        head=PARAMETER_TITLES,
        rows=[row for material in measurement.materials for row in parameter_rows(material)],
        parameters=len(PARAMETER_SYMBOLS),
        remarks=[f"{m.name}: {remark}" for m in measurement.materials for remark in m.remarks],
        unconverged=[f"{m.name}: {note}" for m in measurement.materials for note in getattr(m, "unconverged", ())],
        separation=None if measurement.separation is None else _separation(capture, measurement.separation, crop),
        gloss=None if gloss is None else page_drawing(gloss_plot(gloss, crop), "Maps of β and γ and of their errors"),
        photographs=[
            _photograph(*parts, crop)
            for parts in zip(capture.photographs, measurement.predicted, measurement.residuals, strict=True)
        ],
    )


def _photograph(photograph: Photograph, predicted: NDArray, left: NDArray, crop: tuple[slice, slice]) -> dict[str, Any]:
    pictures = [
        page_picture(_shown(photograph, photograph.values)[crop], f"photograph {photograph.name}", "photograph"),
        page_picture(_shown(photograph, predicted)[crop], f"prediction of {photograph.name}", "prediction"),
        page_picture(residual(left)[crop], f"residual of {photograph.name}", "residual", lossless=True),
    ]
    return {"name": photograph.name, "pictures": pictures}


def _separation(capture: Capture, parts: Separation, crop: tuple[slice, slice]) -> dict[str, Any]:
    photograph = capture.photographs[parts.number]
    pictures = {
        "photograph": photograph.values,
        "diffuse part (body)": np.nan_to_num(parts.body),
        "specular part (interface)": np.nan_to_num(parts.interface),
    }
    shown = [
        page_picture(_shown(photograph, values)[crop], f"{title} of {photograph.name}", title)
        for title, values in pictures.items()
    ]
    return {"name": photograph.name, "pictures": shown}


def _shown(photograph: Photograph, values: NDArray) -> NDArray[np.uint8]:
    """`values` as people see them; as they are, under a display curve, where the camera's response is unknown."""
    if photograph.camera.response is not None and photograph.values.shape[2] == 3:
        return developed(photograph, values)
    grey = photograph.values.mean(axis=2, keepdims=True)
    shown = values if values.shape[2] == 3 else np.repeat(values.mean(axis=2, keepdims=True), 3, axis=2)
    return srgb_encode(np.nan_to_num(shown) * exposure(grey))
