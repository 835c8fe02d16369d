"""Body colours of a measurement as reflectance spectra, where lamp spectrum and camera response are known."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated

import numpy as np

from hagoromo.camera.response import Response
from hagoromo.errors import InputError
from hagoromo.files.record import ForeignRecord, WrittenBy, about, decode, read_json, write_json, written_by
from hagoromo.light.lamp import stated_spectrum
from hagoromo.light.spectrum import Spectrum
from hagoromo.photograph.capture import Capture
from hagoromo.reflectance.material.material_estimate import MaterialEstimate
from hagoromo.reflectance.spectra.spectrum_estimate import SpectrumEstimate


class BodySpectrumRecord(ForeignRecord, frozen=True, kw_only=True):
    """One material of body_spectra.json."""

    version_key = "hagoromo.format_version"

    name: Annotated[str, about("name of the material")]
    wavelengths: Annotated[list[float], about("wavelengths [nm]")]
    values: Annotated[list[float], about("body (diffuse) reflectance, of mean 1 over the channels")]
    standard_error: Annotated[list[float], about("standard error of each value")]
    covariance: Annotated[list[list[float]], about("covariance of the values")]
    probability: Annotated[dict[str, float], about("probability of each prior")]
    hagoromo: Annotated[WrittenBy, about("what wrote the file")] = WrittenBy()


def body_spectra(capture: Capture, materials: Sequence[MaterialEstimate]) -> dict[str, SpectrumEstimate]:
    """Name of each material → the spectrum of its body colour, of mean 1 over the channels.

    Empty where the photographs differ in camera response or lamp spectrum, or these are not known: a body colour can be
    converted for one response and one lamp only. A material whose body colour has no standard error is left out.
    """
    light = _common_light(capture)
    if light is None:
        return {}
    spectra = {}
    for material in materials:
        try:
            spectra[material.name] = material.body_spectrum(*light)
        except InputError:
            continue  # without an error of the colour, its spectrum would have none
    return spectra


def write_body_spectra(path: Path, spectra: Mapping[str, SpectrumEstimate]) -> None:
    """Write a list; each entry: name, wavelengths [nm], values, standard_error, covariance, probability."""
    write_json(path, [_record(name, spectrum) for name, spectrum in spectra.items()])


def read_body_spectra(path: Path) -> dict[str, SpectrumEstimate]:
    """The spectra in body_spectra.json; the evidence of each prior is not in the file and stays empty.

    `InputError` for a file that `write_body_spectra` would not write.
    """
    records = read_json(path)
    if not isinstance(records, list):
        raise InputError(f"{path} must hold a list of spectra: given {type(records).__name__}")
    spectra = {}
    for i, record in enumerate(records):
        where = f"{path} spectrum {i + 1}"
        fields = decode(record, BodySpectrumRecord, where)
        size = len(fields.wavelengths)
        if len(fields.values) != size or [len(row) for row in fields.covariance] != [size] * size:
            raise InputError(f"{where}: {size} wavelengths need as many values and rows of the covariance")
        wavelengths, values = np.array(fields.wavelengths), np.array(fields.values)
        covariance = np.array(fields.covariance)
        spectra[fields.name] = SpectrumEstimate(wavelengths, values, covariance, {}, fields.probability)
    return spectra


def _common_light(capture: Capture) -> tuple[Response, Spectrum] | None:
    """The one camera response and the one lamp spectrum of all photographs; None where there is no such pair."""
    response = capture.photographs[0].camera.response
    spectrum = stated_spectrum([lamp for p in capture.photographs for lamp in p.lamps])
    if not capture.one_response or response is None or spectrum is None:
        return None
    return response, spectrum


def _record(name: str, spectrum: SpectrumEstimate) -> dict[str, object]:
    return {
        "name": name,
        "wavelengths": spectrum.wavelengths.tolist(),
        "values": spectrum.values.tolist(),
        "standard_error": spectrum.standard_error.tolist(),
        "covariance": spectrum.covariance.tolist(),
        "probability": dict(spectrum.probability),
        "hagoromo": written_by(),
    }
