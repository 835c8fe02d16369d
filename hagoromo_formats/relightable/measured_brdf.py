"""Materials as tables of RGL, one file each, with the covariance of what was measured beside them.

With a measured spectrum NAME_spec.bsdf, which Mitsuba's spectral variants read; without one NAME_rgb.bsdf, whose red,
green and blue are the camera's channels, for its rgb variants. covariance.json: of α, β, γ, n, and of each spectrum.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from hagoromo.files.record import write_json, written_by
from hagoromo.light.spectrum import Spectrum
from hagoromo.measurement.photographed import Photographed
from hagoromo.reflectance.material.material_estimate import MaterialEstimate
from hagoromo.reflectance.parameters import ROWS, STATED
from hagoromo.reflectance.reflectance import NEUTRAL, Reflectance
from hagoromo.reflectance.spectra.spectrum_estimate import SpectrumEstimate
from hagoromo_formats.reflectances.rgl_out import Array, write_rgl
from hagoromo_page.publication.lit import three_channels

CHANNELS = np.array([400.0, 500.0, 600.0])  # [nm] where red, green and blue stand while they are evaluated
COVARIANCE = "covariance.json"
FAINT = 0.01  # factor of a `Reflectance`, which refuses to give back more light than it receives; fits are free to


class MeasuredBrdf(NamedTuple):
    """A material's reflectance as a plane, times FAINT, and where it is known: wavelengths (n,) [nm], or R, G and B."""

    reflectance: Reflectance
    wavelengths: Array
    field: Literal["spectra", "rgb"]


def measured_brdf(
    material: MaterialEstimate, spectrum: SpectrumEstimate | None, taken: Photographed | None
) -> MeasuredBrdf:
    """The reflectance of a material by its measured spectrum, or by its channels where it has none (None).

    taken: with what it was photographed; needed for a coloured interface beside a spectrum. `InputError` for an
    interface colour that no smooth spectrum has.
    """
    if spectrum is None:
        body, gloss = (Spectrum(CHANNELS, three_channels(np.array(colour))) for colour in
                       (material.body_colour, material.interface_colour))  # fmt: skip
        return MeasuredBrdf(material.with_spectra(body, gloss, factor=FAINT), CHANNELS, "rgb")
    interface = NEUTRAL
    if len(set(material.interface_colour)) > 1:
        response = None if taken is None else taken.camera.response
        lamp = None if taken is None or not taken.lamps else taken.lamps[0].spectrum
        faint = replace(material, alpha=FAINT * material.alpha, beta=FAINT * material.beta, lobes=())
        interface = faint.reflectance(response, lamp).interface_colour
    made = material.with_spectra(spectrum.spectrum, interface, factor=FAINT)
    return MeasuredBrdf(made, spectrum.wavelengths, "spectra")


def write_measured_brdfs(
    home: Path,
    materials: Sequence[MaterialEstimate],
    spectra: Mapping[str, SpectrumEstimate],
    taken: Photographed | None,
) -> list[str]:
    """Write a table for each material and covariance.json into the folder `home`; gives the names of the tables."""
    files = []
    for number, material in enumerate(materials):
        reflectance, wavelengths, field = measured_brdf(material, spectra.get(material.name), taken)
        files.append(f"{document_name(number, material)}_{'spec' if field == 'spectra' else field}.bsdf")
        write_rgl(home / files[-1], reflectance, wavelengths, field, 1.0 / FAINT)
    known = [covariance_record(one, spectra.get(one.name)) for one in materials]
    each = [
        {"name": one.name, "file": file, **record} for one, file, record in zip(materials, files, known, strict=True)
    ]
    write_json(home / COVARIANCE, {"materials": each, "hagoromo": written_by()})
    return files


def covariance_record(material: MaterialEstimate, spectrum: SpectrumEstimate | None) -> dict[str, Any]:
    """Values, units and covariance (4, 4) of α, β, γ and n, null where one of the two was not estimated; of the others
    that were estimated the standard error; of the body's spectrum, times α, values [1/sr] and covariance (n, n).

    The covariance of that spectrum is its shape's alone: α multiplies all of it.
    """
    errors = material.standard_error
    deviations = np.array([errors.get(key) for key in STATED], float)  # NaN where there is none
    joint = deviations[:, None] * deviations * np.array(material.correlation, float)
    record: dict[str, Any] = {
        "parameters": STATED,
        "units": [ROWS[key].unit for key in STATED],
        "values": [getattr(material, key) for key in STATED],
        "covariance": [[float(one) if np.isfinite(one) else None for one in row] for row in joint],
        "standard_error": {key: error for key, error in errors.items() if key not in STATED and error is not None},
    }
    if spectrum is not None:
        record["body_spectrum"] = {
            "wavelengths_nm": spectrum.wavelengths.tolist(),
            "values_per_sr": (material.alpha * spectrum.values).tolist(),
            "covariance": (material.alpha**2 * spectrum.covariance).tolist(),
        }
    return record


def document_name(number: int, material: MaterialEstimate) -> str:
    """A name in letters, digits and _ that no other material of the object has."""
    return f"m{number}_" + re.sub(r"\W+", "_", material.name, flags=re.ASCII)
