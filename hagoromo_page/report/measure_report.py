"""Report of a measurement: the object to relight, what was found in words, maps, spectra, photographs and figures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.plot import svg_text
from hagoromo.image.spectra.spectra_plot import spectra_figure
from hagoromo.light.colour import srgb_encode
from hagoromo.measurement.material.body_map import Separation
from hagoromo.measurement.measurement import Measurement
from hagoromo.measurement.surface.own_light import NOTABLE
from hagoromo.photograph.capture import Capture
from hagoromo.photograph.photograph import Photograph
from hagoromo.reflectance.material.material_estimate import PARAMETER_TITLES, parameter_rows
from hagoromo_page.publication.document import Viewer
from hagoromo_page.publication.object_page import single_page
from hagoromo_page.publication.publish import page_source
from hagoromo_page.report.contact_sheet import contact_sheet
from hagoromo_page.report.display import exposure
from hagoromo_page.report.findings import findings, findings_of_terms, missing
from hagoromo_page.report.gloss_plot import gloss_plot
from hagoromo_page.report.page import page_drawing, page_picture, page_viewer, write_page
from hagoromo_page.report.report_pictures import around, developed

VIEWER_BYTES = 1_700_000  # of the object to relight
SHEET_BYTES = 2_200_000  # of the photographs
MAP_SIDE_PX = 700  # px, at most, of a side of the pictures of normals and body colours


def write_measure_report(path: Path, measurement: Measurement) -> None:
    """Write the page to `path`: one self-contained HTML file. `InputError` for a measurement without photographs."""
    capture, gloss = measurement.capture, measurement.gloss
    if capture is None:
        raise InputError("the measurement has no photographs, as it was loaded from its files: measure again")
    crop = around(measurement.labels >= 0)
    pixels = sum(material.pixels for material in measurement.materials)
    found = [findings(material, pixels) for material in measurement.materials]
    rows = [parameter_rows(material) for material in measurement.materials]
    write_page(
        path,
        "measure.html.j2",
        name=capture.own_name,
        head=PARAMETER_TITLES,
        rows=[row for own in rows for row in own],
        parameters=len(rows[0]) if len({len(own) for own in rows}) == 1 else 0,
        findings=[*found, *findings_of_terms(measurement.terms)],
        missing=missing(found) + _own_light_missing(measurement),
        assumptions=[f"{what}: {said}" for what, said in measurement.assumptions.items()],
        health=measurement.health,
        remarks=[f"{m.name}: {remark}" for m in measurement.materials for remark in m.remarks],
        unconverged=[f"{m.name}: {note}" for m in measurement.materials for note in getattr(m, "unconverged", ())],
        maps=_maps(measurement, capture, crop),
        spectra=[page_drawing(_spectra(measurement), "Spectra of the body colours with 95 % bands")]
        if measurement.body_spectra
        else [],
        separation=None if measurement.separation is None else _separation(capture, measurement.separation, crop),
        gloss=None if gloss is None else page_drawing(gloss_plot(gloss, crop), "Maps of β and γ and of their errors"),
        sheet=contact_sheet(measurement, _shown, SHEET_BYTES),
        **page_viewer(report_viewer(measurement)),
    )


def report_viewer(measurement: Measurement) -> Viewer | None:
    """The object to relight; None where the measurement knows no pixel of it."""
    if not (measurement.labels >= 0).any():
        return None
    return single_page(page_source(measurement, None), VIEWER_BYTES).viewer


def _spectra(measurement: Measurement) -> str:
    return svg_text(spectra_figure(measurement.body_spectra, quantity="reflectance, mean 1"))


def _maps(measurement: Measurement, capture: Capture, crop: tuple[slice, slice]) -> list[Any]:
    """Pictures of normals and body colours, and of the light that the object sends to itself."""
    camera, known = capture.photographs[0].camera, (measurement.labels >= 0)[..., None]
    facing = measurement.normals @ (np.diag([1.0, -1.0, -1.0]) @ camera.world_to_camera[:3, :3]).T
    normals = np.where(known, np.rint(127.5 * (facing + 1.0)), 255).astype(np.uint8)
    pictures = [page_picture(_small(normals[crop]), "normals", "normals")]
    if measurement.body is not None:
        values = np.nan_to_num(np.asarray(measurement.body.value, np.float64))
        body = np.where(known, _shown(capture.photographs[0], values, own=True), 255).astype(np.uint8)
        pictures.append(page_picture(_small(body[crop]), "body colour", "body colour"))
    own = measurement.own_light
    if own is not None and own.up_to >= NOTABLE:
        share = np.rint(255.0 * np.clip(own.share / own.up_to, 0.0, 1.0)).astype(np.uint8)
        title = f"share of the light that comes from the object itself (white: {100 * own.up_to:.0f} %)"
        grey = np.where(known, np.repeat(share[..., None], 3, axis=2), 0).astype(np.uint8)
        pictures.append(page_picture(_small(grey[crop]), "own light", title))
    return pictures


def _own_light_missing(measurement: Measurement) -> list[str]:
    said = None if measurement.own_light is None else measurement.own_light.undetermined()
    return [] if said is None else [said]


def _small(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    step = max(-(-max(picture.shape[:2]) // MAP_SIDE_PX), 1)
    return np.ascontiguousarray(picture[::step, ::step])


def _separation(capture: Capture, parts: Separation, crop: tuple[slice, slice]) -> dict[str, Any]:
    photograph = capture.photographs[parts.number]
    pictures = {
        "photograph": photograph.values,
        "diffuse part (body)": np.nan_to_num(parts.body),
        "specular part (interface)": np.nan_to_num(parts.interface),
    }
    shown = [
        page_picture(_small(_shown(photograph, values)[crop]), f"{title} of {photograph.name}", title)
        for title, values in pictures.items()
    ]
    return {"name": photograph.name, "pictures": shown}


def _shown(photograph: Photograph, values: NDArray, own: bool = False) -> NDArray[np.uint8]:
    """`values` as people see them; as they are, under a display curve, where the camera's response is unknown.

    own: exposed for themselves, as they are no photograph's.
    """
    if not own and photograph.camera.response is not None and photograph.values.shape[2] == 3:
        return developed(photograph, values)
    level = values if own else photograph.values.mean(axis=2, keepdims=True)
    shown = values if values.shape[2] == 3 else np.repeat(values.mean(axis=2, keepdims=True), 3, axis=2)
    return srgb_encode(np.nan_to_num(shown) * exposure(np.nan_to_num(level)))
