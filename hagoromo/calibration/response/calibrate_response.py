"""Calibrate a camera's response: known spectra and what the camera read of them → spectral sensitivities R_c(λ).

Eq. 10 is linear in R_c, and exact for spectra and curves that are linear between wavelengths. R_c is positive and
smooth; how smooth, and how noisy the readings are, the readings themselves tell (see `positive_curve`).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hagoromo.calibration.response.positive_curve import fit_positive_curve
from hagoromo.camera.response import Response
from hagoromo.errors import InputError
from hagoromo.files.table import read_table

FEWEST_PAIRS = 5


@dataclass(frozen=True, eq=False)
class ResponseCalibration:
    """A response and how well it is known.

    interval_95: (wavelengths, channels, 2), lower and upper bound of each value. standard_error: (wavelengths,
    channels), to first order. residual: (channels,) root mean square of the residuals, relative to the channel's mean
    reading. noise: (channels,) that the readings seem to have, likewise relative. length: (channels,) [nm] over which
    the logarithm of a curve is correlated.
    """

    response: Response
    interval_95: NDArray[np.float64]
    standard_error: NDArray[np.float64]
    residual: NDArray[np.float64]
    noise: NDArray[np.float64]
    length: NDArray[np.float64]


def read_pairs(path: str | Path) -> tuple[NDArray[np.float64], NDArray[np.float64], dict[str, NDArray[np.float64]]]:
    """Pairs in a CSV file, a row per spectrum: columns named by wavelength [nm] hold it, the others the readings.

    Gives wavelengths (n,), spectra (pairs, n) and readings, channel → (pairs,). `InputError` for other tables.
    """
    table = read_table(path)
    at = {name: float(name) for name in table if _is_number(name)}
    wavelengths = np.array(list(at.values()))
    channels = {name: column for name, column in table.items() if name not in at}
    if len(at) < 3 or (np.diff(wavelengths) <= 0).any():
        raise InputError(f"{path}: name three or more columns by increasing wavelengths in nm, such as 400,410,420")
    return wavelengths, np.stack([table[name] for name in at], axis=1), channels


def calibrate_response(
    wavelengths: NDArray[np.float64], spectra: NDArray[np.float64], readings: dict[str, NDArray[np.float64]]
) -> ResponseCalibration:
    """Fit R_c(λ) > 0 to ρ_c = ∫ C_i(λ) R_c(λ) dλ.

    wavelengths: (n,) [nm]. spectra: (pairs, n), C = S·E. readings: channel → (pairs,), linear, in any one unit.
    `InputError` when there are fewer than five pairs, or a channel reads nothing.
    """
    # eq. (10) for piecewise linear C and R: ρ = C M R
    return solve_response(wavelengths, spectra @ overlap_matrix(wavelengths), readings)


def solve_response(
    wavelengths: NDArray[np.float64], matrix: NDArray[np.float64], readings: dict[str, NDArray[np.float64]]
) -> ResponseCalibration:
    """As `calibrate_response`, from the matrix (pairs, n) of the integrals: ρ = matrix R."""
    if len(matrix) < FEWEST_PAIRS:
        raise InputError(f"{len(matrix)} pairs are given and {FEWEST_PAIRS} are the fewest: add known spectra")
    curves, residuals = [], []
    for name, reading in readings.items():
        if not reading.mean() > 0:
            raise InputError(f"channel {name} reads nothing above 0: leave the column out")
        curve = fit_positive_curve(wavelengths, matrix, reading)
        curves.append(curve)
        residuals.append(np.sqrt(np.mean((matrix @ curve.values - reading) ** 2)) / reading.mean())
    response = Response(wavelengths, np.stack([of.values for of in curves], axis=1), tuple(readings), "calibrated")
    return ResponseCalibration(
        response,
        np.stack([of.interval_95 for of in curves], axis=1),
        np.stack([of.standard_error for of in curves], axis=1),
        np.array(residuals),
        np.array([of.noise for of in curves]),
        np.array([of.length for of in curves]),
    )


def overlap_matrix(wavelengths: NDArray[np.float64]) -> NDArray[np.float64]:
    """M (n, n) [nm] with ∫ f g dλ = fᵀ M g for functions that are linear between `wavelengths` (n,) [nm]."""
    step = np.diff(wavelengths)
    matrix = np.diag(np.append(step, 0.0) + np.insert(step, 0, 0.0)) / 3.0
    return matrix + (np.diag(step, 1) + np.diag(step, -1)) / 6.0


def _is_number(name: str) -> bool:
    try:
        float(name)
    except ValueError:
        return False
    return True
