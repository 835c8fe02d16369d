"""Calibrate a camera's response from photographs of a chart: the lamps' and the patches' spectra are known."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hagoromo.calibration.response.calibrate_response import ResponseCalibration, solve_response
from hagoromo.calibration.response.chart import ChartReading, read_chart
from hagoromo.errors import InputError
from hagoromo.light.spectrum import Spectrum, integrate_product

STEP = 10.0  # [nm] between the wavelengths of the curves


def response_from_chart(
    photographs: Sequence[NDArray[Any]],
    lamps: Sequence[Spectrum],
    chart: Sequence[Spectrum],
    corners: Sequence[ArrayLike] | None = None,
) -> tuple[ResponseCalibration, tuple[ChartReading, ...]]:
    """The response that explains what `photographs` (h, w, 3), linear, show of `chart` under `lamps`, one each.

    The photographs are of one exposure and the lamps' spectra in one unit. corners: of the chart in each photograph
    (4, 2) [px]; found when not given. Patches that are clipped are left out. Also gives the readings.

    One lamp tells the product of its spectrum and the response only: a wrong spectrum of it goes unseen.
    """
    if len(photographs) != len(lamps) or not photographs:
        raise InputError(f"{len(photographs)} photographs and {len(lamps)} lamps are given: give one lamp for each")
    if corners is not None and len(corners) != len(photographs):
        raise InputError(f"{len(photographs)} photographs and corners of {len(corners)} charts are given")
    every = (*lamps, *chart)
    first, last = max(s.wavelengths[0] for s in every), min(s.wavelengths[-1] for s in every)
    wavelengths = np.arange(STEP * np.ceil(first / STEP), last + 0.5 * STEP, STEP)
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
