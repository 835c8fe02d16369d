"""`hagoromo calibrate response`: pairs, or photographs of a chart → the curves, their intervals and a plot."""

from __future__ import annotations

import io
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hagoromo.calibration.response.calibrate_response import ResponseCalibration, calibrate_response, read_pairs
from hagoromo.calibration.response.chart import chart_spectra
from hagoromo.calibration.response.chart_response import response_from_chart
from hagoromo.errors import InputError
from hagoromo.files.exr import read_exr
from hagoromo.files.picture import read_picture
from hagoromo.files.table import write_table
from hagoromo.files.whole import whole_file
from hagoromo.light.spectrum import Spectrum
from hagoromo_figures.demo.plots import panels

DOUBTFUL = 0.03  # relative noise of a reading beyond which it is rather the spectra or the light that are wrong
COLOURS = {"R": "#b00020", "G": "#2e7d32", "B": "#1f4e8c"}


@dataclass(frozen=True)
class ChartSetting:
    """A chart by name or CSV; the lamps, one a photograph; corners x, y of the charts [px], eight a photograph."""

    chart: str
    lamps: Sequence[str]
    corners: Sequence[float] = ()


def calibrate_response_to(
    sources: Sequence[Path], setting: ChartSetting, out: Path, force: bool
) -> tuple[ResponseCalibration, tuple[Path, Path, Path]]:
    """The calibration, and the paths of its curves, their 95 % intervals and their plot."""
    if out.suffix.lower() != ".csv":
        raise InputError(f"{out} is to be a table: give a name that ends in .csv")
    intervals, plot = out.with_name(f"{out.stem}_interval.csv"), out.with_suffix(".png")
    with whole_file(out, force) as curves, whole_file(intervals, force) as bounds, whole_file(plot, force) as picture:
        found = _calibrated(sources, setting)
        response = found.response
        wavelength = {"wavelength_nm": response.wavelengths}
        write_table(curves, wavelength | dict(zip(response.channels, response.values.T, strict=True)))
        ends = {
            f"{name}_{end}": found.interval_95[:, channel, k]
            for channel, name in enumerate(response.channels)
            for k, end in enumerate(("low", "high"))
        }
        write_table(bounds, wavelength | ends)
        picture.write_bytes(_plot(found))
    if found.noise.max() > DOUBTFUL:
        warnings.warn(
            f"known spectra explain the readings to {100 * found.noise.max():.0f} % only: are they linear in light, "
            "without glare, and do the spectra belong to them?",
            stacklevel=2,
        )
    return found, (out, intervals, plot)


def _calibrated(sources: Sequence[Path], setting: ChartSetting) -> ResponseCalibration:
    if not setting.lamps:
        if len(sources) != 1 or sources[0].suffix.lower() != ".csv":
            raise InputError("give one CSV of pairs, or photographs of a chart with a --lamp for each")
        return calibrate_response(*read_pairs(sources[0]))
    corners = None
    if setting.corners:
        if len(setting.corners) != 8 * len(sources):
            asked = f"{len(sources)} photographs have {8 * len(sources)}"
            raise InputError(f"--corners has {len(setting.corners)} numbers: {asked}, x and y of four corners each")
        corners = list(np.reshape(setting.corners, (len(sources), 4, 2)))
    photographs = [_linear(path) for path in sources]
    lamps = [Spectrum.load(lamp) for lamp in setting.lamps]
    return response_from_chart(photographs, lamps, chart_spectra(setting.chart), corners)[0]


def _linear(path: Path) -> NDArray:
    """(h, w, 3) of a developed EXR, NaN where it is invalid, or of a 16-bit picture."""
    if path.suffix.lower() != ".exr":
        return read_picture(path)[..., :3]
    channels, _ = read_exr(path)
    missing = [name for name in "RGB" if name not in channels]
    if missing:
        raise InputError(f"{path} has no channel {', '.join(missing)}: give a developed photograph")
    values = np.stack([channels[name] for name in "RGB"], axis=2)
    return np.where(channels["A"][..., None] > 0.0, values, np.nan) if "A" in channels else values


def _plot(found: ResponseCalibration) -> bytes:
    figure, (axis,) = panels(1, 6.4, 3.6)
    response = found.response
    top = response.values.max()
    for channel, name in enumerate(response.channels):
        colour = COLOURS.get(name, f"C{channel}")
        low, high = found.interval_95[:, channel].T / top
        axis.fill_between(response.wavelengths, low, high, color=colour, alpha=0.25, linewidth=0)
        axis.plot(response.wavelengths, response.values[:, channel] / top, color=colour, label=name)
    axis.set_xlabel("wavelength [nm]", fontsize=9)
    axis.set_ylabel("response [of the greatest], 95 % interval", fontsize=9)
    axis.set_ylim(0.0, 1.3)
    axis.legend(fontsize=8, frameon=False)
    data = io.BytesIO()
    figure.savefig(data, format="png", dpi=120, metadata={"Software": None})
    return data.getvalue()
