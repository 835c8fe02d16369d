"""Measured reflectance spectra from which priors are learnt: the data sets of colour-science, or the user's CSV file.

All are (spectra, wavelengths) on `WAVELENGTHS`, relative to a perfect white diffuser.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hagoromo.errors import InputError
from hagoromo.files.table import read_table
from hagoromo.light.spectrum import VISIBLE, WAVELENGTH_COLUMNS

WAVELENGTHS = np.arange(VISIBLE[0], VISIBLE[1] + 1.0, 10.0)  # [nm]; reflectance is linear between them
SAME = 1e-3  # largest difference of two spectra that are one measurement, listed twice
MOST = 5000  # spectra in a prior, whose memory is proportional to their number


@cache
def surfaces() -> NDArray[np.float64]:
    """Some 350 surfaces of many types from the data of colour-science, without charts of 24 patches.

    The 190 training patches of rawtoaces (AMPAS), the 99 samples of CIE 224:2017, the test samples of CIE 13.3-1995
    and of the colour quality scale (NIST), and the preferred memory colours chart (Luo 2024).
    """
    import colour
    from colour.characterisation import read_training_data_rawtoaces_v1
    from colour.quality import SDS_TCS, SDS_VS
    from colour.quality.cfi2017 import load_TCS_CIE2017

    tables = (read_training_data_rawtoaces_v1(), load_TCS_CIE2017(colour.SpectralShape(380, 780, 5)))
    of_tables = [_on_grid(table.wavelengths, row) for table in tables for row in table.values.T]
    sets = (*SDS_TCS.values(), *SDS_VS.values(), colour.SDS_COLOURCHECKERS["PMC"])
    of_sets = [_on_grid(curve.wavelengths, curve.values) for curves in sets for curve in curves.values()]
    spectra = np.array([*of_tables, *of_sets])
    first = [
        i for i, row in enumerate(spectra) if not (np.abs(spectra[:i] - row).max(axis=1, initial=0.0) < SAME).any()
    ]
    spectra = spectra[first]
    spectra.flags.writeable = False
    return spectra


def read_spectra(path: str | Path) -> NDArray[np.float64]:
    """Reflectance spectra of a CSV file: a wavelength column [nm] that covers 400–700 nm, then one per spectrum.

    `InputError` for wavelengths that do not increase or do not cover the range, values outside 0…1.2, or too many.
    """
    table = read_table(path)
    key = next((name for name in WAVELENGTH_COLUMNS if name in table), next(iter(table)))
    wavelengths = table.pop(key)
    if not 1 <= len(table) <= MOST:
        raise InputError(f"{path} has {len(table)} spectra beside {key}: give 1 to {MOST}")
    if (np.diff(wavelengths) <= 0).any() or wavelengths[0] > VISIBLE[0] or wavelengths[-1] < VISIBLE[1]:
        span = f"{wavelengths[0]:g} to {wavelengths[-1]:g}"
        raise InputError(f"{path}: column {key} goes from {span}: wavelengths must increase and cover 400–700 nm")
    spectra = np.array([_on_grid(wavelengths, column) for column in table.values()])
    wrong = (spectra < 0.0).any(axis=1) | (spectra > 1.2).any(axis=1) | (spectra.mean(axis=1) <= 0.0)
    if wrong.any():
        raise InputError(f"{path}: {list(table)[int(np.argmax(wrong))]} is no reflectance: give values from 0 to 1")
    return spectra


def apart(spectra: NDArray[np.float64], tested: NDArray[np.float64], least: float = 0.03) -> NDArray[np.float64]:
    """The `spectra` (n, wavelengths) that are not near copies of a `tested` one (m, wavelengths), at any brightness.

    A near copy, scaled to fit best, differs by less than `least` of the tested spectrum's mean, root mean square.
    """
    scale = (tested @ spectra.T) / np.sum(spectra**2, axis=1)
    off = np.sqrt(np.mean((tested[:, None] - scale[..., None] * spectra) ** 2, axis=2))
    return spectra[(off >= least * tested.mean(axis=1)[:, None]).all(axis=0)]


def _on_grid(wavelengths: ArrayLike, values: ArrayLike) -> NDArray[np.float64]:
    """Linear between wavelengths; a set that ends at 730 nm or begins at 400 nm is extended to the grid."""
    return np.interp(WAVELENGTHS, np.asarray(wavelengths, np.float64), np.asarray(values, np.float64))
