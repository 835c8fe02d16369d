"""body_spectra.json: the body colours of a measurement as reflectance spectra, where lamps and response are known."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np

from hagoromo.camera.response import Response
from hagoromo.errors import InputError
from hagoromo.files.record import ForeignRecord, WrittenBy, about, write_json, written_by
from hagoromo.light.spectrum import Spectrum
from hagoromo.measurement.known_shape import Measurement
from hagoromo.photograph.capture import Capture
from hagoromo.reflectance.material.material_estimate import MaterialEstimate


class BodySpectrumRecord(ForeignRecord, frozen=True, kw_only=True):
    """One material of body_spectra.json."""

    name: Annotated[str, about("name of the material")]
    wavelengths: Annotated[list[float], about("wavelengths [nm]")]
    values: Annotated[list[float], about("body (diffuse) reflectance, of mean 1 over the channels")]
    standard_error: Annotated[list[float], about("standard error of each value")]
    covariance: Annotated[list[list[float]], about("covariance of the values")]
    probability: Annotated[dict[str, float], about("probability of each prior")]
    hagoromo: Annotated[WrittenBy, about("what wrote the file")] = WrittenBy()


def write_body_spectra(path: Path, capture: Capture, measurement: Measurement) -> bool:
    """Write each material's body spectrum, of mean 1 over the channels, with its covariance; whether there is one.

    A list; each: name, wavelengths [nm], values, standard_error, covariance, probability of each prior. Nothing is
    written where photographs differ in camera response or lamp spectrum, or do not know them: one reading of a body
    colour belongs to one of each.
    """
    light = _one_light(capture)
    if light is None:
        return False
    records = [record for material in measurement.materials if (record := _record(material, *light)) is not None]
    if records:
        write_json(path, records)
    return bool(records)


def _one_light(capture: Capture) -> tuple[Response, Spectrum] | None:
    responses = {id(p.camera.response): p.camera.response for p in capture.photographs}
    lamps = [lamp.spectrum for photograph in capture.photographs for lamp in photograph.lamps]
    response = next(iter(responses.values()), None)
    if response is None or not lamps or not all(_same(response, other) for other in responses.values()):
        return None
    first, unstated = lamps[0], Spectrum.constant(1.0)  # what a lamp without a spectrum is given
    if np.array_equal(first.wavelengths, unstated.wavelengths) and np.ptp(first.values) == 0.0:
        return None
    alike = all(
        np.array_equal(lamp.wavelengths, first.wavelengths)
        and np.allclose(lamp.values * first.values.sum(), first.values * lamp.values.sum())
        for lamp in lamps
    )
    return (response, first) if alike else None


def _same(a: Response, b: Response | None) -> bool:
    return b is not None and np.array_equal(a.wavelengths, b.wavelengths) and np.array_equal(a.values, b.values)


def _record(material: MaterialEstimate, response: Response, lamp: Spectrum) -> dict[str, Any] | None:
    """None where the photographs leave the body colour without an error: its spectrum would have none."""
    try:
        spectrum = material.body_spectrum(response, lamp)
    except InputError:
        return None
    return {
        "name": material.name,
        "wavelengths": spectrum.wavelengths.tolist(),
        "values": spectrum.values.tolist(),
        "standard_error": spectrum.standard_error.tolist(),
        "covariance": spectrum.covariance.tolist(),
        "probability": dict(spectrum.probability),
        "hagoromo": written_by(),
    }
