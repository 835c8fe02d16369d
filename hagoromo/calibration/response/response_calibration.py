"""ResponseCalibration: a calibrated response, how well it is known, what was found in its readings; and its files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.calibration.response.chart_falloff import Exchanged
from hagoromo.calibration.response.doubtful_readings import BlackLevel, Doubtful
from hagoromo.calibration.response.reading_transfer import ReadingTransfer
from hagoromo.camera.response import Response
from hagoromo.errors import InputError
from hagoromo.files.record import write_json, written_by
from hagoromo.files.table import read_table, write_table
from hagoromo.files.whole import whole_files
from hagoromo.least_squares.fit_status import FitStatus

LEAST_SHARED = 0.01  # relative error that the readings of a lamp share, from which it is reported


@dataclass(frozen=True, eq=False)
class ResponseCalibration:
    """A response and how well it is known.

    interval_95: (wavelengths, channels, 2), lower and upper bound of each value. standard_error: (wavelengths,
    channels), to first order. residual: (channels,) root mean square of the residuals, relative to the channel's mean
    reading. noise: (channels,) estimated noise of the readings, also relative. length: (channels,) correlation length
    of the curve [nm]. statuses: (channels,) how the fits ended. transfers: (channels,) power and offset of the readings
    over light; where they are certain, the curve is that of the linearised readings. doubtful: readings that were left
    out. priors: (channels,) what the evidence chose: smooth, or like published cameras. shared: (channels,) relative
    standard deviation of the factor that the readings of one lamp share. gains: (channels, lamps, 2) those factors and
    their standard errors; None where lamps are not known. findings: what else was found, in sentences.
    black: a black level that may have been left in all readings; the intervals have it. level: (channels,) mean of the
    readings that were used. falloff: (photographs, 5) of the light over a chart, see `light_over_chart`, 0 where it is
    even. exchanged: the photographs whose lamps fit when exchanged. pairs: names of the pairs.
    """

    response: Response
    interval_95: NDArray[np.float64]
    standard_error: NDArray[np.float64]
    residual: NDArray[np.float64]
    noise: NDArray[np.float64]
    length: NDArray[np.float64]
    statuses: tuple[FitStatus, ...] = ()
    transfers: tuple[ReadingTransfer | None, ...] = ()
    doubtful: Doubtful | None = None
    priors: tuple[str, ...] = ()
    shared: tuple[float, ...] = ()
    gains: NDArray[np.float64] | None = None
    findings: tuple[str, ...] = ()
    black: BlackLevel | None = None
    level: NDArray[np.float64] | None = None
    falloff: NDArray[np.float64] | None = None
    exchanged: Exchanged | None = None
    pairs: tuple[str, ...] = ()

    def linear(self, values: NDArray[np.float64], channel: int) -> NDArray[np.float64]:
        """Values of a channel of the photographs, made proportional to light where they certainly are not."""
        transfer = self.transfers[channel] if self.transfers else None
        if transfer is None or not transfer.certain or self.level is None:
            return values
        level = float(self.level[channel])
        return level * np.maximum(values / level - transfer.offset, 0.0) ** (1.0 / transfer.power)

    def remarks(self) -> list[str]:
        """One line for each fault: readings left out, a transfer that is not linear, fits that did not converge."""
        pairs = zip(self.response.channels, self.statuses, strict=False)
        said = [] if self.doubtful is None else self.doubtful.remarks(self.pairs)
        for channel, transfer in zip(self.response.channels, self.transfers, strict=False):
            if transfer is not None and transfer.certain:
                said.append(f"channel {channel}: {_transfer_said(transfer)}")
        reported = any(transfer is not None and transfer.certain for transfer in self.transfers)
        if self.black is not None and not reported and (line := self.black.remark()) is not None:
            said.append(line)
        for channel, shared in zip(self.response.channels, self.shared, strict=False):
            if shared > LEAST_SHARED:
                said.append(
                    f"channel {channel}: the readings of a lamp share errors of {100 * shared:.1f} %: fitted, and in "
                    "the intervals"
                )
        said += self.findings
        return said + [status.remark(f"channel {channel}") for channel, status in pairs if not status.converged]

    def __repr__(self) -> str:
        """The channels and their residuals."""
        residuals = zip(self.response.channels, self.residual, strict=True)
        return f"ResponseCalibration({', '.join(f'{name}: residual {100 * r:.2f} %' for name, r in residuals)})"

    def record(self) -> dict[str, Any]:
        """What was found, per channel, as the JSON beside the curves has it; null where it is not known."""
        channels = {}
        for k, name in enumerate(self.response.channels):
            transfer = self.transfers[k] if self.transfers else None
            channels[name] = {
                "residual": _number(self.residual[k]),
                "noise": _number(self.noise[k]),
                "correlation_length_nm": _number(self.length[k]),
                "prior": self.priors[k] if self.priors else None,
                "clipped_pairs": [] if self.doubtful is None else (self.doubtful.clipped[name] + 1).tolist(),
                "transfer": None if transfer is None else _transfer_record(transfer),
                "shared_by_lamp": self.shared[k] if self.shared else None,
                "gains": None if self.gains is None else [[_number(v) for v in row] for row in self.gains[k]],
                "converged": self.statuses[k].converged if self.statuses else None,
            }
        repeated = [] if self.doubtful is None else (self.doubtful.repeated + 1).tolist()
        black = None if self.black is None else self.black._asdict()
        return {
            "channels": channels, "black_level": black, "repeated_pairs": repeated,
            "falloff": None if self.falloff is None else self.falloff.tolist(),
            "remarks": self.remarks(), "hagoromo": written_by(),
        }  # fmt: skip

    def save(self, path: str | Path, force: bool = False) -> tuple[Path, Path, Path]:
        """Write the curves to the CSV `path`, which `Response.load` reads; beside it their 95 % intervals, and a JSON.

        The JSON holds what was found (`record`). Returns the paths. `InputError` for a name that does not end in
        .csv, or an existing file without `force`.
        """
        targets = self.paths(path)
        wavelength = {"wavelength_nm": self.response.wavelengths}
        ends = {
            f"{name}_{end}": self.interval_95[:, channel, k]
            for channel, name in enumerate(self.response.channels)
            for k, end in enumerate(("low", "high"))
        }
        with whole_files(targets, force) as (response, intervals, findings):
            self.response.write_table(response)
            write_table(intervals, wavelength | ends)
            write_json(findings, self.record())
        return targets

    @staticmethod
    def load(path: str | Path) -> ResponseCalibration:
        """The calibration whose curves `save` wrote to `path`, with the intervals beside it.

        The tables hold no standard errors, residuals, noise and lengths: these are NaN. `InputError` where a file is
        missing or the two do not belong together.
        """
        curves, bounds, _ = ResponseCalibration.paths(path)
        response, table = Response.load(curves), read_table(bounds)
        ends = [[f"{name}_{end}" for end in ("low", "high")] for name in response.channels]
        missing = [name for pair in ends for name in pair if name not in table]
        if missing or len(next(iter(table.values()))) != len(response.wavelengths):
            raise InputError(f"{bounds} does not hold the intervals of {curves}: give files written together")
        interval = np.stack([np.stack([table[name] for name in pair], axis=1) for pair in ends], axis=1)
        errors, unknown = np.full(response.values.shape, np.nan), np.full(len(response.channels), np.nan)
        return ResponseCalibration(response, interval, errors, unknown, unknown, unknown)

    @staticmethod
    def paths(path: str | Path) -> tuple[Path, Path, Path]:
        """The files of the curves, of their intervals and of what was found; `InputError` if `path` is no .csv."""
        path = Path(path)
        if path.suffix.lower() != ".csv":
            raise InputError(f"{path} is not the name of a CSV table: give a name that ends in .csv")
        return path, path.with_name(f"{path.stem}_interval.csv"), path.with_suffix(".json")


def _transfer_said(transfer: ReadingTransfer) -> str:
    """What a wrong transfer is, and what to do."""
    power, offset = transfer.errors
    said = []
    if transfer.bent or transfer.stated:
        said.append(f"follow light to the power {transfer.power:.3f} ± {power:.3f}, not 1")
    if transfer.shifted:
        said.append(f"are {100 * transfer.offset:+.1f} ± {100 * offset:.1f} % of their mean off in the dark")
    cure = "linearise them with the right transfer, or subtract the right black; the curve is of the corrected readings"
    return f"the readings {' and '.join(said)}: {cure}"


def _transfer_record(transfer: ReadingTransfer) -> dict[str, Any]:
    power, offset = transfer.errors
    return {
        "power": transfer.power, "power_error": power, "offset": transfer.offset, "offset_error": offset,
        "corrected": transfer.certain,
    }  # fmt: skip


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
