"""Measured: the demo's photographs, their measurement, a predicted photograph, and what the page says of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from hagoromo.image.scene.settings import Settings
from hagoromo.image.simulate import simulate, visible_shape
from hagoromo.light.spectrum import Spectrum
from hagoromo.measurement.known_shape import measure_known_shape
from hagoromo.photograph.capture import load_capture, save_capture
from hagoromo.progress import Progress, part_of
from hagoromo.reflectance.material.material_estimate import MaterialEstimate
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo_matter.demo.measurement import coverage, named, rightly_labelled, rows
from hagoromo_matter.demo.relit import relit
from hagoromo_matter.demo.report_measured import MeasurementResults, measured_parts
from hagoromo_matter.demo.samples import LAMP_SPECTRUM, bench, bench_camera, true_reflectances
from hagoromo_matter.demo.size import Size

LAMPS_MEASURED = 3  # number of lamps for the measurement; the photograph under the last is held out
TAKEN, FITTED = 0.3, 0.8  # of the time, when the photographs are taken, and when the materials are fitted


def measured(home: Path, size: Size, progress: Progress) -> dict[str, Any]:
    """Write the folders capture, measure and relit into `home`; "record": figures, and HTML of the page by its part."""
    camera = bench_camera(size.capture_binning)
    response, lamp = camera.response, Spectrum.named(LAMP_SPECTRUM)
    assert response is not None
    truth = true_reflectances(camera)
    samples = bench(truth, camera)
    settings = Settings(samples=size.capture_samples, seed=size.seed)
    taking = part_of(progress, 0.0, TAKEN, "photographs")
    save_capture(simulate(samples, settings, "Four samples", taking, percentile=100.0), home / "capture")
    surface = visible_shape(samples).surface
    capture = load_capture(home / "capture", frames=slice(0, LAMPS_MEASURED))
    fitting = part_of(progress, TAKEN, FITTED - TAKEN, "materials")
    measurement = named(measure_known_shape(capture, progress=fitting), surface, list(truth))
    (home / "measure").mkdir()
    measurement.write_into(home / "measure")
    table = rows(measurement.materials, truth, response, lamp)
    found = reflectances_of(measurement.materials, size)
    progress(FITTED, "kept photograph")
    aside = load_capture(home / "capture", frames=slice(LAMPS_MEASURED, None)).photographs[0]
    view = relit(samples, found, aside, surface >= 0, settings)
    view.write(home / "relit")
    record = {
        "table": [row.record() for row in table],
        "coverage": coverage(table),
        "rightly_labelled": rightly_labelled(measurement, surface, list(truth)),
        "relit": {"measured": dict(view.measured), "ideal": dict(view.ideal)},
    }
    known = replace(measurement, capture=capture)
    return {"record": record} | measured_parts(
        MeasurementResults(record, size, capture, aside, known, table, truth, found, view)
    )


def reflectances_of(materials: Sequence[MaterialEstimate], size: Size) -> dict[str, Reflectance]:
    """The measured reflectances by name, their spectra as seen by the demo's camera under its lamps."""
    response = bench_camera(size.capture_binning).response
    assert response is not None
    lamp = Spectrum.named(LAMP_SPECTRUM)
    return {material.name: material.reflectance(response, lamp) for material in materials}
