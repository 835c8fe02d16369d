"""LampCalibration: the lamps calibrated with chrome balls, their errors, and their file, lamps.json."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from hagoromo.calibration.lamps.ball import Ball
from hagoromo.calibration.lamps.highlight import Highlight
from hagoromo.calibration.lamps.lamp_records import check_of_balls
from hagoromo.calibration.lamps.place import LampPlace
from hagoromo.calibration.lamps.reading import LampReading
from hagoromo.calibration.lamps.strength import Strength
from hagoromo.errors import InputError
from hagoromo.files.record import decode, read_json, save_json, written_by
from hagoromo.least_squares.fit_status import FitStatus
from hagoromo.light.lamp import Lamp
from hagoromo.light.lamp_spread import LampSpread
from hagoromo.photograph.lamps_file import LampsRecord

LAMP = ("name", "to_lamp", "position", "intensity")  # keys of a lamp in a capture's transforms.json


@dataclass(frozen=True, eq=False)
class LampCalibration:
    """readings: of each lamp, its position and errors. strengths: of each lamp; None if it was not estimated.

    balls: the chrome balls. spread: of the directions; None for lamps from which normals cannot be solved, `remark`
    then says why. settings: those of `calibrate_lamps`.
    """

    readings: tuple[LampReading | LampPlace, ...]
    strengths: tuple[Strength | None, ...]
    balls: tuple[Ball, ...]
    spread: LampSpread | None
    remark: str = ""
    settings: Mapping[str, Any] = field(default_factory=dict)

    def __repr__(self) -> str:
        """The number of lamps and their standard errors."""
        errors = [reading.standard_error_deg for reading in self.readings]
        return f"LampCalibration({len(errors)} lamps, standard errors {min(errors):.2f}–{max(errors):.2f}°)"

    @property
    def lamps(self) -> tuple[Lamp, ...]:
        """The lamps, for a capture."""
        return tuple(Lamp(**{key: record[key] for key in LAMP if key in record}) for record in self._readings())

    def record(self) -> dict[str, Any]:
        """The content of lamps.json."""
        readings = self._readings()
        return {
            "hagoromo": written_by(self.settings),
            "lamps": [{key: record[key] for key in LAMP if key in record} for record in readings],
            "ball": self.balls[0].record(),
            "balls": [ball.record() for ball in self.balls],
            "spread": None if self.spread is None else self.spread._asdict(),
            "readings": readings,
        }

    def save(self, path: str | Path, force: bool = False) -> Path:
        """Write lamps.json, which `load_lamps` reads; `InputError` where it exists without `force`."""
        return save_json(path, self.record(), force)

    @staticmethod
    def load(path: str | Path) -> LampCalibration:
        """The calibration that `save` wrote; `load_lamps` gives its lamps alone, and reads files of other programs.

        The file holds no pixels: edges of balls and highlights are empty, and the points that near lamps were seen
        from are NaN. `InputError` for a file that `save` did not write.
        """
        record = decode(read_json(path), LampsRecord, str(path))
        try:
            check_of_balls(record, str(path))
            return _from_record(record)
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(
                f"{path} is no lamps.json of chrome balls ({error!r}): read its lamps by load_lamps"
            ) from error

    def _readings(self) -> list[dict[str, Any]]:
        records = []
        for reading, strength in zip(self.readings, self.strengths, strict=True):
            known = {} if strength is None else {"intensity": strength.intensity.tolist(), **strength.record()}
            records.append(reading.record() | known)
        return records


def lamps_on_balls(readings: Sequence[LampReading | LampPlace]) -> list[LampReading]:
    """The readings on each ball, of far and near lamps."""
    return [one for lamp in readings for one in ((lamp,) if isinstance(lamp, LampReading) else lamp.readings)]


def _from_record(record: LampsRecord) -> LampCalibration:
    balls = tuple(_ball(one) for one in record.balls)
    if not balls or not record.readings:
        raise ValueError("no ball")
    readings = [_place(one, balls) if "balls" in one else _reading(one, balls[0]) for one in record.readings]
    return LampCalibration(
        tuple(readings),
        tuple(_strength(one) for one in record.readings),
        balls,
        None if record.spread is None else LampSpread(**record.spread),
        settings=record.hagoromo.settings,
    )


def _ball(record: Mapping[str, Any]) -> Ball:
    (x, y), (x_error, y_error, radius_error) = record["centre_px"], record["standard_error_px"]
    across, down = record.get("centre_from_mask_px", (0.0, 0.0))
    return Ball(
        (x, y), record["radius_px"], (x_error, y_error, radius_error), record["rms_px"], np.zeros((0, 2)),
        source=record.get("outline", "mask"), softness=record.get("softness_px"), from_mask=(across, down),
        edge_share=record.get("edge_share"),
    )  # fmt: skip


def _reading(record: Mapping[str, Any], ball: Ball) -> LampReading:
    x, y = record["highlight_px"]
    error, rival = record["highlight_standard_error_px"], record["rival"]
    other = record.get("disputed_px")
    highlight = Highlight(
        (x, y), error, 0, rival, np.zeros((0, 2)), np.zeros((0, 0)), record.get("highlight_from", "ellipse"),
        other and (other[0], other[1]), record.get("dispute", ""),
    )  # fmt: skip
    error, shading = record["standard_error_deg"], record.get("from_shading_deg")
    return LampReading(record["name"], np.array(record["to_lamp"]), error, highlight, ball, shading)


def _place(record: Mapping[str, Any], balls: Sequence[Ball]) -> LampPlace:
    near = "position" in record
    position = np.array(record["position"]) if near else None
    readings = tuple(_reading(one, ball) for one, ball in zip(record["balls"], balls, strict=True))
    to_lamp = np.mean([one.to_lamp for one in readings], axis=0) if near else np.array(record["to_lamp"])
    return LampPlace(
        record["name"], np.full(3, np.nan), to_lamp / np.linalg.norm(to_lamp), record["standard_error_deg"], position,
        np.array(record["covariance_m2"]) if near else None, record["inverse_distance_per_m"],
        record["inverse_distance_error_per_m"], record["misfit"], readings,
    )  # fmt: skip


def _strength(record: Mapping[str, Any]) -> Strength | None:
    if "intensity_from" not in record:
        return None
    shading = record.get("shading")
    return Strength(
        np.array(record["intensity"]), np.array(record["intensity_standard_error"]), record["intensity_from"],
        record["intensity_scatter"], shading and (np.array(shading["to_lamp"]), shading["standard_error_deg"]),
        tuple(FitStatus.from_record(one) for one in record.get("intensity_convergence", ())),
    )  # fmt: skip
