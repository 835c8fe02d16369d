"""Calibrate a camera's response from photographs of a chart, with known spectra of the lamps and the patches."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hagoromo.calibration.response.calibrate_response import ResponseCalibration, solve_response
from hagoromo.calibration.response.chart import ChartReading, chart_spectra, read_chart
from hagoromo.errors import InputError
from hagoromo.files.exr import read_exr
from hagoromo.files.picture import read_picture
from hagoromo.light.spectrum import Spectrum, integrate_product

WAVELENGTH_STEP_NM = 10.0  # [nm] between the wavelengths of the curves


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
    patches are ignored.

    One lamp measures only the product of its spectrum and the response, so an error of the spectrum is not detected.
    """
    pictures = [_linear(one) if isinstance(one, (str, Path)) else np.asarray(one) for one in photographs]
    spectra = [Spectrum.load(str(lamp) if isinstance(lamp, Path) else lamp) for lamp in lamps]
    patches = chart_spectra(str(chart)) if isinstance(chart, (str, Path)) else chart
    return read_response(pictures, spectra, patches, corners)[0]


def read_response(
    photographs: Sequence[NDArray[Any]],
    lamps: Sequence[Spectrum],
    chart: Sequence[Spectrum],
    corners: Sequence[ArrayLike] | None = None,
) -> tuple[ResponseCalibration, tuple[ChartReading, ...]]:
    """As `response_from_chart`, from arrays and spectra; also returns the readings of the chart in each photograph."""
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
    for i, (photograph, lamp) in enumerate(zip(photographs, lamps, strict=True)):
        reading = read_chart(photograph, [p.mean() for p in chart], None if corners is None else corners[i])
        readings.append(reading)
        for patch, value in zip(chart, reading.values, strict=True):
            if np.isfinite(value).all():
                # eq. (10), exact: ρ = Σ_j R_j ∫ S E Λ_j dλ
                rows.append([integrate_product(patch, lamp, tent, lo=first, hi=last) for tent in tents])
                values.append(value)
    red, green, blue = np.array(values).T
    return solve_response(wavelengths, np.array(rows), {"R": red, "G": green, "B": blue}), tuple(readings)


def _linear(path: str | Path) -> NDArray:
    """(h, w, 3) values of a developed EXR, NaN where invalid, or of a 16-bit picture."""
    if Path(path).suffix.lower() != ".exr":
        return read_picture(path)[..., :3]
    channels, _ = read_exr(path)
    missing = [name for name in "RGB" if name not in channels]
    if missing:
        raise InputError(f"{path} has no channel {', '.join(missing)}: give a developed photograph")
    values = np.stack([channels[name] for name in "RGB"], axis=2)
    return np.where(channels["A"][..., None] > 0.0, values, np.nan) if "A" in channels else values
