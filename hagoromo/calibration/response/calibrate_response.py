"""Calibrate a camera's response: known spectra and the camera's readings of them → spectral sensitivities R_c(λ).

Eq. (10) is linear in R_c, and exact for spectra and curves that are linear between wavelengths. R_c is positive and
smooth; its smoothness and the noise are estimated from the readings (see `positive_curve`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hagoromo.calibration.response.chart import ChartReading, chart_spectra, read_chart
from hagoromo.calibration.response.chart_falloff import (
    DOUBTFUL_MISFIT,
    ChartReadings,
    exchanged_lamps,
    falloff,
    falloff_findings,
    photograph_at_fault,
    share_of_light,
)
from hagoromo.calibration.response.curve_prior import CurvePrior, priors_of
from hagoromo.calibration.response.doubtful_readings import black_level, doubtful_readings, with_black_level
from hagoromo.calibration.response.positive_curve import PositiveCurve, fit_positive_curve
from hagoromo.calibration.response.response_calibration import ResponseCalibration
from hagoromo.camera.response import Response
from hagoromo.errors import InputError
from hagoromo.files.exr import read_exr
from hagoromo.files.picture import read_picture
from hagoromo.files.table import is_number, read_table
from hagoromo.light.spectrum import VISIBLE, Spectrum, integrate_product, smooth_rgb_basis

LAMP_COLUMN = "lamp"
FEWEST_PAIRS = 5  # least number of pairs: smoothness and noise are estimated, too
WAVELENGTH_STEP_NM = 10.0  # [nm] between the wavelengths of the curves


class Pairs(NamedTuple):
    """Known spectra and the camera's readings of them.

    wavelengths: (n,) [nm]. spectra: (pairs, n), C = S·E. readings: channel → (pairs,), linear, in one arbitrary unit.
    lamps: (pairs,) number of the lamp of each, whose strength may be wrong; None: not known.
    """

    wavelengths: NDArray[np.float64]
    spectra: NDArray[np.float64]
    readings: dict[str, NDArray[np.float64]]
    lamps: NDArray[np.float64] | None = None


def read_pairs(path: str | Path) -> Pairs:
    """Pairs in a CSV file, one row per spectrum: columns named by wavelength [nm] hold the spectrum, others readings.

    A column named lamp holds the number of the lamp (or exposure) of each pair, whose strength may be wrong.
    `InputError` for other tables.
    """
    table = read_table(path)
    wavelength_of = {name: float(name) for name in table if is_number(name)}
    wavelengths = np.array(list(wavelength_of.values()))
    lamps = table.pop(LAMP_COLUMN, None)
    channels = {name: column for name, column in table.items() if name not in wavelength_of}
    if len(wavelength_of) < 3 or (np.diff(wavelengths) <= 0).any():
        raise InputError(f"{path}: name three or more columns by increasing wavelengths in nm, such as 400,410,420")
    return Pairs(wavelengths, np.stack([table[name] for name in wavelength_of], axis=1), channels, lamps)


def calibrate_response(pairs: Pairs | str | Path) -> ResponseCalibration:
    """Fit R_c(λ) > 0 to ρ_c = ∫ C_i(λ) R_c(λ) dλ.

    pairs: known spectra and the camera's readings of them, or a CSV file of them, see `read_pairs`.
    `InputError` for fewer than five pairs, or a channel whose mean reading is not above 0.
    """
    wavelengths, spectra, readings, lamps = pairs if isinstance(pairs, Pairs) else read_pairs(pairs)
    # eq. (10) for piecewise linear C and R: ρ = C M R
    return solve_response(wavelengths, spectra @ overlap_matrix(wavelengths), readings, lamps=lamps)


def solve_response(
    wavelengths: NDArray[np.float64],
    matrix: NDArray[np.float64],
    readings: dict[str, NDArray[np.float64]],
    priors: Callable[[str, NDArray[np.float64]], Sequence[CurvePrior]] = priors_of,
    lamps: NDArray[Any] | None = None,
) -> ResponseCalibration:
    """As `calibrate_response`, from the matrix (pairs, n) of the integrals: ρ = matrix R.

    priors: of a channel at wavelengths [nm]; of those the evidence chooses. lamps: see `Pairs`.
    """
    if len(matrix) < FEWEST_PAIRS:
        raise InputError(f"{len(matrix)} pairs are given and {FEWEST_PAIRS} are needed: add known spectra")
    for name, reading in readings.items():
        if not (np.isfinite(reading).any() and np.nanmean(reading) > 0):
            raise InputError(f"the mean reading of channel {name} is not above 0: leave the column out")
    known = {name: priors(name, wavelengths) for name in readings}
    doubtful = doubtful_readings(wavelengths, matrix, readings, {name: of[0] for name, of in known.items()})
    numbers = None if lamps is None else np.unique(lamps, return_inverse=True)[1]
    used = {name: doubtful.sound(name, len(matrix)) & np.isfinite(of) for name, of in readings.items()}

    def fit(name: str, power: float | None = None) -> PositiveCurve:
        sound, rounding = used[name], _rounding(readings[name])
        groups = None if numbers is None else numbers[sound]
        return fit_positive_curve(
            wavelengths, matrix[sound], readings[name][sound], known[name], rounding, power, groups
        )

    curves = {name: fit(name) for name in readings}
    curves = _with_common_power(curves, fit)
    means = np.array([readings[name][used[name]].mean() for name in curves])
    black = black_level(list(curves.values()), means)
    if black is not None:
        curves = {name: with_black_level(curve, black, channel) for channel, (name, curve) in enumerate(curves.items())}
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
        tuple(curve.shared for curve in curves.values()),
        _gains(list(curves.values()), used, numbers),
        black=black,
        level=means,
    )


def _gains(
    curves: Sequence[PositiveCurve], used: dict[str, NDArray[np.bool_]], numbers: NDArray[np.intp] | None
) -> NDArray[np.float64] | None:
    """(channels, lamps, 2): NaN where a channel has no sound reading of a lamp; None without lamps."""
    if numbers is None or not any(curve.gains is not None for curve in curves):
        return None
    gains = np.full((len(curves), int(numbers.max()) + 1, 2), np.nan)
    for channel, (curve, sound) in enumerate(zip(curves, used.values(), strict=True)):
        if curve.gains is not None:
            gains[channel, np.unique(numbers[sound])] = curve.gains
    return gains


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


def response_from_chart(
    photographs: Sequence[str | Path | NDArray[Any]],
    lamps: Sequence[str | Path | Spectrum],
    chart: str | Path | Sequence[Spectrum] = "BabelColor Average",
    corners: Sequence[ArrayLike] | None = None,
) -> ResponseCalibration:
    """The response estimated from linear photographs of a chart of 24 patches under `lamps`, one photograph per lamp.

    photographs: developed EXR or 16-bit files of one exposure, or arrays (height, width, 3), NaN where invalid. lamps:
    spectra in one unit, names or CSV files. chart: name of a chart of colour-science, a CSV with a column per patch,
    or the patches' spectra. corners: of the chart in each photograph (4, 2) [px]; detected if not given. Clipped
    patches are ignored. The light may fall off over the chart: that is fitted as well and stated in the result, as is a
    photograph that contradicts the others.

    One lamp measures only the product of its spectrum and the response, so an error of the spectrum is not detected.
    """
    pictures = [_linear(one) if isinstance(one, (str, Path)) else np.asarray(one) for one in photographs]
    spectra = [Spectrum.load(str(lamp) if isinstance(lamp, Path) else lamp) for lamp in lamps]
    patches = chart_spectra(str(chart)) if isinstance(chart, (str, Path)) else chart
    named = all(isinstance(one, (str, Path)) for one in photographs)
    labels = [Path(str(one)).name for one in photographs] if named else None
    return read_response(pictures, spectra, patches, corners, labels)[0]


def read_response(
    photographs: Sequence[NDArray[Any]],
    lamps: Sequence[Spectrum],
    chart: Sequence[Spectrum],
    corners: Sequence[ArrayLike] | None = None,
    labels: Sequence[str] | None = None,
) -> tuple[ResponseCalibration, tuple[ChartReading, ...]]:
    """As `response_from_chart`, from arrays and spectra; also returns the readings of the chart in each photograph.

    labels: names of the photographs in what is said of them.
    """
    if len(photographs) != len(lamps) or not photographs:
        raise InputError(f"{len(photographs)} photographs and {len(lamps)} lamps are given: give one lamp for each")
    if corners is not None and len(corners) != len(photographs):
        raise InputError(
            f"{len(photographs)} photographs and corners of {len(corners)} charts are given: give one set for each"
        )
    every = (*lamps, *chart)
    first, last = max(s.wavelengths[0] for s in every), min(s.wavelengths[-1] for s in every)
    wavelengths = np.arange(
        WAVELENGTH_STEP_NM * np.ceil(first / WAVELENGTH_STEP_NM), last + 0.5 * WAVELENGTH_STEP_NM, WAVELENGTH_STEP_NM
    )
    wavelengths = wavelengths[wavelengths <= last]
    if len(wavelengths) < 3:
        raise InputError(f"lamps and chart have {first:g} to {last:g} nm in common: give spectra over 400–700 nm")
    tents = [Spectrum(wavelengths, row) for row in np.eye(len(wavelengths))]
    readings, rows, values = [], [], []
    basis = smooth_rgb_basis()
    for i, (photograph, lamp) in enumerate(zip(photographs, lamps, strict=True)):
        expected = [[integrate_product(patch, lamp, band) for band in basis] for patch in chart]
        reading = read_chart(photograph, expected, None if corners is None else corners[i])
        readings.append(reading)
        for patch, value in zip(chart, reading.values, strict=True):
            # eq. (10), exact: ρ = Σ_j R_j ∫ S E Λ_j dλ
            rows.append([integrate_product(patch, lamp, tent, lo=first, hi=last) for tent in tents])
            values.append(value)
    photograph, patch = np.divmod(np.arange(len(rows)), len(chart))
    table = ChartReadings(
        wavelengths, np.array(rows), dict(zip("RGB", np.array(values).T, strict=True)), photograph, patch
    )
    names = [f"photograph {i + 1}" for i in range(len(photographs))] if labels is None else list(labels)
    return _solved(table, names), tuple(readings)


def _solved(chart: ChartReadings, names: Sequence[str]) -> ResponseCalibration:
    """The response by readings without the falloff of the light, and what was found in the photographs."""
    priors = {channel: priors_of(channel, chart.wavelengths) for channel in chart.readings}
    uneven = falloff(chart, priors)
    share = share_of_light(chart, uneven)
    even = chart.divided(share)
    calibration = solve_response(chart.wavelengths, chart.matrix, even.readings, lamps=chart.photograph)
    findings, exchanged = falloff_findings(chart, share, names), None
    if max(calibration.noise.max(), *calibration.shared) > DOUBTFUL_MISFIT:
        linear = {name: calibration.linear(of, k) for k, (name, of) in enumerate(even.readings.items())}
        straight = even._replace(readings=linear)
        exchanged = exchanged_lamps(straight, priors)
        at_fault = photograph_at_fault(straight, priors, names) if exchanged is None else [exchanged.finding(names)]
        findings += at_fault
    of = [f" of {name}" if len(names) > 1 else "" for name in names]
    pairs = tuple(f"patch {p + 1}{of[k]}" for k, p in zip(chart.photograph.tolist(), chart.patch.tolist(), strict=True))
    return replace(calibration, findings=tuple(findings), falloff=uneven, exchanged=exchanged, pairs=pairs)


def _linear(path: str | Path) -> NDArray:
    """(h, w, 3) values of a developed EXR, NaN where invalid, or of a 16-bit picture."""
    if Path(path).suffix.lower() != ".exr":
        return read_picture(path)[..., :3]
    channels, _ = read_exr(path)
    missing = [name for name in "RGB" if name not in channels]
    if missing:
        raise InputError(f"{path} has no channel {', '.join(missing)}: give a developed photograph")
    values = np.stack([channels[name] for name in "RGB"], axis=2)
    layers = [channels.get(f"valid.{name}", channels.get("A")) for name in "RGB"]
    return values if layers[0] is None else np.where(np.stack(layers, axis=2) > 0.0, values, np.nan)  # type: ignore[arg-type]
