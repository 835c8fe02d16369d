"""Calibrate a camera's response: known spectra and the camera's readings of them → spectral sensitivities R_c(λ).

Eq. (10) is linear in R_c, and exact for spectra and curves that are linear between wavelengths. R_c is positive and
smooth; its smoothness and the noise are estimated from the readings (see `positive_curve`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.calibration.response.curve_prior import CurvePrior, priors_of
from hagoromo.calibration.response.doubtful_readings import Doubtful, doubtful_readings
from hagoromo.calibration.response.positive_curve import PositiveCurve, Transfer, fit_positive_curve
from hagoromo.camera.response import Response
from hagoromo.errors import InputError
from hagoromo.files.table import read_table, write_table
from hagoromo.files.whole import whole_files
from hagoromo.least_squares import FitStatus
from hagoromo.light.spectrum import VISIBLE

FEWEST_PAIRS = 5  # least number of pairs: smoothness and noise are estimated, too


@dataclass(frozen=True, eq=False)
class ResponseCalibration:
    """A response and how well it is known.

    interval_95: (wavelengths, channels, 2), lower and upper bound of each value. standard_error: (wavelengths,
    channels), to first order. residual: (channels,) root mean square of the residuals, relative to the channel's mean
    reading. noise: (channels,) estimated noise of the readings, also relative. length: (channels,) correlation length
    of the curve [nm]. statuses: (channels,) how the fits ended. transfers: (channels,) power and offset of the readings
    over light; where they are certain, the curve is that of the linearised readings. doubtful: readings that were left
    out. priors: (channels,) what the evidence chose: smooth, or like published cameras. noise_factors: (channels,) by
    which similar spectra share errors. findings: what else was found, in sentences.
    """

    response: Response
    interval_95: NDArray[np.float64]
    standard_error: NDArray[np.float64]
    residual: NDArray[np.float64]
    noise: NDArray[np.float64]
    length: NDArray[np.float64]
    statuses: tuple[FitStatus, ...] = ()
    transfers: tuple[Transfer | None, ...] = ()
    doubtful: Doubtful | None = None
    priors: tuple[str, ...] = ()
    noise_factors: tuple[float, ...] = ()
    findings: tuple[str, ...] = ()

    def remarks(self) -> list[str]:
        """One line for each fault: readings left out, a transfer that is not linear, fits that did not converge."""
        pairs = zip(self.response.channels, self.statuses, strict=False)
        said = [] if self.doubtful is None else self.doubtful.remarks()
        for channel, transfer in zip(self.response.channels, self.transfers, strict=False):
            if transfer is not None and transfer.certain:
                said.append(f"channel {channel}: {_transfer_said(transfer)}")
        said += self.findings
        return said + [status.remark(f"channel {channel}") for channel, status in pairs if not status.converged]

    def __repr__(self) -> str:
        """The channels and their residuals."""
        residuals = zip(self.response.channels, self.residual, strict=True)
        return f"ResponseCalibration({', '.join(f'{name}: residual {100 * r:.2f} %' for name, r in residuals)})"

    def save(self, path: str | Path, force: bool = False) -> tuple[Path, Path]:
        """Write the curves to the CSV `path`, which `Response.load` reads, and their 95 % intervals beside it.

        Returns both paths. `InputError` for a name that does not end in .csv, or an existing file without `force`.
        """
        curves, bounds = self.paths(path)
        wavelength = {"wavelength_nm": self.response.wavelengths}
        ends = {
            f"{name}_{end}": self.interval_95[:, channel, k]
            for channel, name in enumerate(self.response.channels)
            for k, end in enumerate(("low", "high"))
        }
        with whole_files((curves, bounds), force) as (response, intervals):
            self.response.write_table(response)
            write_table(intervals, wavelength | ends)
        return curves, bounds

    @staticmethod
    def load(path: str | Path) -> ResponseCalibration:
        """The calibration whose curves `save` wrote to `path`, with the intervals beside it.

        The files hold no standard errors, residuals, noise and lengths: these are NaN. `InputError` where a file is
        missing or the two do not belong together.
        """
        curves, bounds = ResponseCalibration.paths(path)
        response, table = Response.load(curves), read_table(bounds)
        ends = [[f"{name}_{end}" for end in ("low", "high")] for name in response.channels]
        missing = [name for pair in ends for name in pair if name not in table]
        if missing or len(next(iter(table.values()))) != len(response.wavelengths):
            raise InputError(f"{bounds} does not hold the intervals of {curves}: give files written together")
        interval = np.stack([np.stack([table[name] for name in pair], axis=1) for pair in ends], axis=1)
        errors, unknown = np.full(response.values.shape, np.nan), np.full(len(response.channels), np.nan)
        return ResponseCalibration(response, interval, errors, unknown, unknown, unknown)

    @staticmethod
    def paths(path: str | Path) -> tuple[Path, Path]:
        """The files of the curves and of their intervals; `InputError` if `path` does not end in .csv."""
        path = Path(path)
        if path.suffix.lower() != ".csv":
            raise InputError(f"{path} is not the name of a CSV table: give a name that ends in .csv")
        return path, path.with_name(f"{path.stem}_interval.csv")


class Pairs(NamedTuple):
    """Known spectra and the camera's readings of them.

    wavelengths: (n,) [nm]. spectra: (pairs, n), C = S·E. readings: channel → (pairs,), linear, in one arbitrary unit.
    """

    wavelengths: NDArray[np.float64]
    spectra: NDArray[np.float64]
    readings: dict[str, NDArray[np.float64]]


def read_pairs(path: str | Path) -> Pairs:
    """Pairs in a CSV file, one row per spectrum: columns named by wavelength [nm] hold the spectrum, others readings.

    `InputError` for other tables.
    """
    table = read_table(path)
    wavelength_of = {name: float(name) for name in table if _is_number(name)}
    wavelengths = np.array(list(wavelength_of.values()))
    channels = {name: column for name, column in table.items() if name not in wavelength_of}
    if len(wavelength_of) < 3 or (np.diff(wavelengths) <= 0).any():
        raise InputError(f"{path}: name three or more columns by increasing wavelengths in nm, such as 400,410,420")
    return Pairs(wavelengths, np.stack([table[name] for name in wavelength_of], axis=1), channels)


def calibrate_response(pairs: Pairs | str | Path) -> ResponseCalibration:
    """Fit R_c(λ) > 0 to ρ_c = ∫ C_i(λ) R_c(λ) dλ.

    pairs: known spectra and the camera's readings of them, or a CSV file of them, see `read_pairs`.
    `InputError` for fewer than five pairs, or a channel whose mean reading is not above 0.
    """
    wavelengths, spectra, readings = pairs if isinstance(pairs, Pairs) else read_pairs(pairs)
    # eq. (10) for piecewise linear C and R: ρ = C M R
    return solve_response(wavelengths, spectra @ overlap_matrix(wavelengths), readings)


def solve_response(
    wavelengths: NDArray[np.float64],
    matrix: NDArray[np.float64],
    readings: dict[str, NDArray[np.float64]],
    priors: Callable[[str, NDArray[np.float64]], Sequence[CurvePrior]] = priors_of,
) -> ResponseCalibration:
    """As `calibrate_response`, from the matrix (pairs, n) of the integrals: ρ = matrix R.

    priors: of a channel at wavelengths [nm]; of those the evidence chooses.
    """
    if len(matrix) < FEWEST_PAIRS:
        raise InputError(f"{len(matrix)} pairs are given and {FEWEST_PAIRS} are needed: add known spectra")
    for name, reading in readings.items():
        if not (np.isfinite(reading).any() and np.nanmean(reading) > 0):
            raise InputError(f"the mean reading of channel {name} is not above 0: leave the column out")
    known = {name: priors(name, wavelengths) for name in readings}
    doubtful = doubtful_readings(wavelengths, matrix, readings, {name: of[0] for name, of in known.items()})
    used = {name: doubtful.sound(name, len(matrix)) & np.isfinite(of) for name, of in readings.items()}

    def fit(name: str, power: float | None = None) -> PositiveCurve:
        sound, rounding = used[name], _rounding(readings[name])
        return fit_positive_curve(
            wavelengths, matrix[sound], readings[name][sound], known[name], rounding=rounding, power=power
        )

    curves = {name: fit(name) for name in readings}
    curves = _with_common_power(curves, fit)
    residuals = [_residual(matrix[used[name]], readings[name][used[name]], curve) for name, curve in curves.items()]
    transfers = [curve.transfer for curve in curves.values()]
    # the readings were explained by light at all of the wavelengths, so that eq. (10) takes them all
    limits = min(VISIBLE[0], float(wavelengths[0])), max(VISIBLE[1], float(wavelengths[-1]))
    response = Response(
        wavelengths,
        np.stack([curve.values for curve in curves.values()], axis=1),
        tuple(readings),
        "calibrated",
        limits,
    )
    return ResponseCalibration(
        response,
        np.stack([curve.interval_95 for curve in curves.values()], axis=1),
        np.stack([curve.standard_error for curve in curves.values()], axis=1),
        np.array(residuals),
        np.array([curve.noise for curve in curves.values()]),
        np.array([curve.length for curve in curves.values()]),
        tuple(curve.status for curve in curves.values()),
        tuple(transfers),
        doubtful,
        tuple(curve.prior for curve in curves.values()),
        tuple(curve.noise_factor for curve in curves.values()),
    )


def _with_common_power(
    curves: dict[str, PositiveCurve], fit: Callable[[str, float | None], PositiveCurve]
) -> dict[str, PositiveCurve]:
    """If the channels together show a power other than 1: each fitted with it, where it alone leaves that open."""
    known = [curve.transfer for curve in curves.values() if curve.transfer is not None]
    if len(known) < 2 or not any(one.bent for one in known):
        return curves
    weight = np.array([1.0 / one.errors[0] ** 2 for one in known])
    power = float(weight @ [one.power for one in known] / weight.sum())
    return {
        name: curve if curve.transfer is None or curve.transfer.bent else fit(name, power)
        for name, curve in curves.items()
    }


def _residual(matrix: NDArray[np.float64], reading: NDArray[np.float64], curve: PositiveCurve) -> float:
    """Root mean square of readings (made linear, if they were not) less those of the curve, over the mean reading."""
    share = reading / reading.mean()
    if curve.transfer is not None and curve.transfer.certain:
        share = np.maximum(share - curve.transfer.offset, 0.0) ** (1.0 / curve.transfer.power)
    return float(np.sqrt(np.mean((matrix @ curve.values / reading.mean() - share) ** 2)))


def _rounding(reading: NDArray[np.float64]) -> float:
    """Variance of rounding, if all readings are whole numbers."""
    whole = bool(np.array_equal(reading, np.rint(reading))) and reading.max() > 1.0
    return 1.0 / 12.0 if whole else 0.0


def overlap_matrix(wavelengths: NDArray[np.float64]) -> NDArray[np.float64]:
    """M (n, n) [nm] with ∫ f g dλ = fᵀ M g for functions that are linear between `wavelengths` (n,) [nm]."""
    step = np.diff(wavelengths)
    matrix = np.diag(np.append(step, 0.0) + np.insert(step, 0, 0.0)) / 3.0
    return matrix + (np.diag(step, 1) + np.diag(step, -1)) / 6.0


def _transfer_said(transfer: Transfer) -> str:
    """What a wrong transfer is, and what to do."""
    power, offset = transfer.errors
    said = []
    if transfer.bent or transfer.stated:
        said.append(f"follow light to the power {transfer.power:.3f} ± {power:.3f}, not 1")
    if transfer.shifted:
        said.append(f"are {100 * transfer.offset:+.1f} ± {100 * offset:.1f} % of their mean off in the dark")
    cure = "linearise them with the right transfer, or subtract the right black; the curve is of the corrected readings"
    return f"the readings {' and '.join(said)}: {cure}"


def _is_number(name: str) -> bool:
    try:
        float(name)
    except ValueError:
        return False
    return True
