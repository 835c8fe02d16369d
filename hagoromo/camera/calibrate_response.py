"""Calibrate a camera's response: known spectra and what the camera read of them → spectral sensitivities R_c(λ).

Eq. 10 is linear in R_c, and exact for spectra and curves that are linear between wavelengths. It is solved with
R_c ≥ 0 and a penalty on the curve's second difference, whose weight is chosen by leaving each spectrum out once.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.response import Response
from hagoromo.errors import InputError
from hagoromo.files.table import read_table

FEWEST_PAIRS = 5
PENALTIES = np.logspace(-10, 2, 25)  # smoothness weights tried, relative to the scale of the equations


@dataclass(frozen=True, eq=False)
class ResponseCalibration:
    """A response and how well it is known.

    standard_error: (wavelengths, channels), of the values where they are above 0 (0 where the bound holds them).
    residual: (channels,) root mean square of the residuals, relative to the channel's mean reading.
    penalty: (channels,) weight of smoothness that predicts a spectrum left out best.
    """

    response: Response
    standard_error: NDArray[np.float64]
    residual: NDArray[np.float64]
    penalty: NDArray[np.float64]


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
    """Fit R_c(λ) ≥ 0 to ρ_c = ∫ C_i(λ) R_c(λ) dλ.

    wavelengths: (n,) [nm]. spectra: (pairs, n), C = S·E. readings: channel → (pairs,), linear, in any one unit.
    `InputError` when there are fewer than five pairs, or a channel reads nothing.
    """
    if len(spectra) < FEWEST_PAIRS:
        raise InputError(f"{len(spectra)} pairs are given and {FEWEST_PAIRS} are the fewest: add known spectra")
    # eq. (10) for piecewise linear C and R: ρ = C M R
    matrix = spectra @ overlap_matrix(wavelengths)
    curves, errors, residuals, penalties = [], [], [], []
    for name, reading in readings.items():
        if not reading.max() > 0:
            raise InputError(f"channel {name} reads nothing above 0: leave the column out")
        curve, error, penalty = _fit(matrix, reading)
        curves.append(curve)
        errors.append(error)
        penalties.append(penalty)
        residuals.append(np.sqrt(np.mean((matrix @ curve - reading) ** 2)) / reading.mean())
    response = Response(wavelengths, np.stack(curves, axis=1), tuple(readings), "calibrated")
    return ResponseCalibration(response, np.stack(errors, axis=1), np.array(residuals), np.array(penalties))


def overlap_matrix(wavelengths: NDArray[np.float64]) -> NDArray[np.float64]:
    """M (n, n) [nm] with ∫ f g dλ = fᵀ M g for functions that are linear between `wavelengths` (n,) [nm]."""
    step = np.diff(wavelengths)
    matrix = np.diag(np.append(step, 0.0) + np.insert(step, 0, 0.0)) / 3.0
    return matrix + (np.diag(step, 1) + np.diag(step, -1)) / 6.0


def _fit(matrix: NDArray[np.float64], reading: NDArray[np.float64]) -> tuple[NDArray, NDArray, float]:
    """Curve (n,), its standard error (n,) and the penalty that predicts best."""
    n = matrix.shape[1]
    bend = np.diff(np.eye(n), 2, axis=0) * np.linalg.norm(matrix) * np.sqrt(n)
    penalty = min(PENALTIES, key=lambda weight: _prediction_error(matrix, reading, bend, weight))
    curve = _smooth(matrix, reading, bend, penalty)
    free = curve > 0.0
    design = matrix[:, free]
    inverse = np.linalg.pinv(design.T @ design + penalty * bend[:, free].T @ bend[:, free])
    parameters = np.trace(inverse @ design.T @ design)
    variance = np.sum((matrix @ curve - reading) ** 2) / max(len(reading) - parameters, 1.0)
    error = np.zeros(n)
    error[free] = np.sqrt(variance * np.diag(inverse @ design.T @ design @ inverse))
    return curve, error, float(penalty)


def _smooth(matrix: NDArray, reading: NDArray, bend: NDArray, penalty: float) -> NDArray[np.float64]:
    """argmin over R ≥ 0 of |matrix R − reading|² + penalty |bend R|²."""
    from scipy.optimize import nnls

    stacked = np.concatenate([matrix, np.sqrt(penalty) * bend])
    try:
        return nnls(stacked, np.concatenate([reading, np.zeros(len(bend))]), maxiter=100 * len(bend))[0]
    except RuntimeError as error:
        raise InputError("the fit of the response does not converge: add spectra that differ more") from error


def _prediction_error(matrix: NDArray, reading: NDArray, bend: NDArray, penalty: float) -> float:
    """Sum of squared errors of each reading predicted by the fit to all the others."""
    pairs = np.arange(len(reading))
    return sum(
        float(matrix[i] @ _smooth(matrix[pairs != i], reading[pairs != i], bend, penalty) - reading[i]) ** 2
        for i in pairs
    )


def _is_number(name: str) -> bool:
    try:
        float(name)
    except ValueError:
        return False
    return True
