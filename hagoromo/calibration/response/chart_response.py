"""Calibrate a camera's response from photographs of a chart, with known spectra of the lamps and the patches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hagoromo.calibration.response.calibrate_response import solve_response
from hagoromo.calibration.response.chart import ChartReading, chart_spectra, read_chart
from hagoromo.calibration.response.chart_falloff import (
    DOUBTFUL_MISFIT,
    ChartReadings,
    falloff,
    falloff_findings,
    photograph_at_fault,
)
from hagoromo.calibration.response.curve_prior import priors_of
from hagoromo.calibration.response.response_calibration import ResponseCalibration
from hagoromo.errors import InputError
from hagoromo.files.exr import read_exr
from hagoromo.files.picture import read_picture
from hagoromo.light.spectrum import Spectrum, integrate_product, smooth_rgb_basis

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
    share = falloff(chart, priors)
    even = chart.divided(share)
    calibration = solve_response(chart.wavelengths, chart.matrix, even.readings, lamps=chart.photograph)
    findings = falloff_findings(chart, share, names)
    if max(calibration.noise.max(), *calibration.shared) > DOUBTFUL_MISFIT:
        findings += photograph_at_fault(even, priors, names)
    return replace(calibration, findings=tuple(findings))


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
