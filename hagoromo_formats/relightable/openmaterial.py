"""ASAM OpenMATERIAL 3D: each material as a .xomp with a look-up table of its BRDF over wavelengths and angles.

OpenMATERIAL 3D 1.1.0 (ASAM e.V.): material_schema.json and material_brdf_schema.json. A table is sorted by wavelength
[m], zenith angles of lamp and eye and azimuth of the eye [rad]; a value is the BRDF [1/sr]. Azimuths are counted from
the direction to the lamp, so that the mirror direction is at π. What the specification asks for and a measurement does
not know, copyrights, licence and authors, is marked as not stated.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from uuid import NAMESPACE_URL, uuid5

import numpy as np

from hagoromo.files.record import finite_json, write_json
from hagoromo.files.whole import write_text
from hagoromo.measurement.photographed import Photographed
from hagoromo.reflectance.material.material_estimate import MaterialEstimate
from hagoromo.reflectance.parameters import lost
from hagoromo.reflectance.spectra.spectrum_estimate import SpectrumEstimate
from hagoromo_formats.relightable.measured_brdf import (
    FAINT,
    Array,
    MeasuredBrdf,
    covariance_record,
    document_name,
    measured_brdf,
)

VERSION = "1.1.0"  # of the specification
SCHEMAS = f"https://raw.githubusercontent.com/asam-ev/OpenMATERIAL-3D/refs/tags/v{VERSION}/schemas"
NOT_STATED = {"copyrights": ["not stated"], "license": "NOASSERTION", "authors": ["not stated"]}  # NOASSERTION: of SPDX
MEASURED = (
    "Reflectance measured from photographs under known lamps. "
    "The azimuth of the direction to the lamp is 0, and that of its mirror direction π."
)
EVERY_NM = 20.0  # [nm] between wavelengths of a table
LAMP, EYE, ROUND = np.arange(0.0, 81.0, 10.0), np.arange(0.0, 81.0, 5.0), np.arange(0.0, 181.0, 15.0)  # [°] of a table
ABOUT = np.array([0.5, 1.0, 2.0, 3.0])  # widths of the highlight from its middle, where tables are finer
FARTHEST = 85.0  # [°] of the eye from the normal
DIGITS = 6  # significant, of numbers in a table


def write_openmaterial(
    home: Path,
    materials: Sequence[MaterialEstimate],
    spectra: Mapping[str, SpectrumEstimate],
    taken: Photographed | None,
) -> list[str]:
    """Write NAME.xomp and NAME_brdf.xompt for each material; gives their names. Each has a spectrum."""
    files = []
    for number, material in enumerate(materials):
        name, spectrum = document_name(number, material), spectra[material.name]
        known, left_out = covariance_record(material, spectrum), lost("openmaterial", material)
        about = {
            "name": material.name,
            "description": MEASURED + (f" Lost: {left_out}." if left_out else ""),
            "materialVersion": "1.0.0",
            "openMaterial3dVersion": VERSION,
            **NOT_STATED,
        }
        table, seed = f"{name}_brdf.xompt", finite_json([material.name, known], name)
        properties = {"brdfUris": [table], "customProperties": {"hagoromo": known}}
        write_json(
            home / f"{name}.xomp",
            {
                "$schema": f"{SCHEMAS}/material_schema.json",
                "metadata": about | {"uuid": str(uuid5(NAMESPACE_URL, seed))},
                "materialProperties": properties,
            },
        )
        wavelengths, rows = look_up_table(measured_brdf(material, spectrum, taken), material)
        sources = "measurement, fitted by a reflectance model whose values these are"
        head = {
            "$schema": f"{SCHEMAS}/material_brdf_schema.json",
            "metadata": about
            | {
                "uuid": str(uuid5(NAMESPACE_URL, seed + table)),
                "sources": sources,
                "typicalSensorTechnology": "camera",
            },
            "brdf": {"wavelengths": [_number(one) for one in wavelengths], "lookupTable": []},
        }
        text = ",\n".join(f"[{', '.join(map(repr, map(_number, row)))}]" for row in rows.tolist())
        whole = finite_json(head, table, indent=1).replace('"lookupTable": []', f'"lookupTable": [\n{text}\n]')
        write_text(home / table, whole + "\n")
        files += [f"{name}.xomp", table]
    return files


def look_up_table(made: MeasuredBrdf, material: MaterialEstimate) -> tuple[Array, Array]:
    """Wavelengths (n,) [m] and rows (N, 5) of a table, in the order of the specification."""
    first, last = made.wavelengths[0], made.wavelengths[-1]
    nanometres = np.arange(EVERY_NM * np.ceil(first / EVERY_NM), last + 1e-6, EVERY_NM)
    lamp, eye, turn = angles(material)
    to_lamp, to_eye = _vector(lamp, np.zeros_like(lamp)), _vector(eye, turn)
    values = made.reflectance.evaluate([0.0, 0.0, 1.0], to_lamp, to_eye, nanometres) / (FAINT * to_lamp[:, 2:])
    metres = 1e-9 * nanometres
    where = np.stack([lamp, eye, turn], 1)
    rows = [np.column_stack([np.full(len(where), one), where, values[:, k]]) for k, one in enumerate(metres)]
    return metres, np.concatenate(rows)


def angles(material: MaterialEstimate) -> tuple[Array, Array, Array]:
    """Zenith angles of lamp and eye and the azimuth of the eye [rad], (N,), sorted; finer about the highlights."""
    widths = np.array([gamma for _, gamma in material.all_lobes()]) if material.beta > 0.0 else np.zeros(0)
    steps = np.degrees(2.0 * np.outer(widths, ABOUT).ravel())  # of the eye: twice those of the half vector
    found = []
    for lamp in LAMP:
        eyes = _between(np.r_[EYE, lamp, lamp - steps, lamp + steps], FARTHEST)
        turns = _between(np.r_[ROUND, 180.0 - steps], 180.0)
        found += [(lamp, eye, turn) for eye in eyes for turn in turns]
    return tuple(np.radians(column) for column in np.array(found).T)  # type: ignore[return-value]


def _between(values: Array, last: float) -> Array:
    """Different values from 0 to `last` [°], sorted, a thousandth of a degree apart or more."""
    return np.unique(np.round(values[(values >= 0.0) & (values <= last)], 3))


def _vector(zenith: Array, azimuth: Array) -> Array:
    return np.stack([np.sin(zenith) * np.cos(azimuth), np.sin(zenith) * np.sin(azimuth), np.cos(zenith)], 1)


def _number(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")
