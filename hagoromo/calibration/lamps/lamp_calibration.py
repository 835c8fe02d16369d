"""LampCalibration: the lamps that chrome balls show, how well each is known, and their file, lamps.json."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hagoromo.calibration.lamps.ball import Ball
from hagoromo.calibration.lamps.highlight import LampReading
from hagoromo.calibration.lamps.place import LampPlace
from hagoromo.calibration.lamps.strength import Strength
from hagoromo.files.record import write_json, written_by
from hagoromo.files.whole import whole_file
from hagoromo.light.lamp import Lamp
from hagoromo.light.lamp_spread import Spread

LAMP = ("name", "to_lamp", "position", "intensity")  # keys of a lamp in a capture's transforms.json


@dataclass(frozen=True, eq=False)
class LampCalibration:
    """readings: of each lamp, its place and errors. strengths: of each lamp; None where none was asked for.

    balls: the chrome balls. spread: of the directions; None for lamps from which normals cannot be solved, `remark`
    then says why.
    """

    readings: tuple[LampReading | LampPlace, ...]
    strengths: tuple[Strength | None, ...]
    balls: tuple[Ball, ...]
    spread: Spread | None
    remark: str = ""

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
            "hagoromo": written_by(),
            "lamps": [{key: record[key] for key in LAMP if key in record} for record in readings],
            "ball": self.balls[0].record(),
            "balls": [ball.record() for ball in self.balls],
            "spread": None if self.spread is None else self.spread._asdict(),
            "readings": readings,
        }

    def save(self, path: str | Path, force: bool = False) -> Path:
        """Write lamps.json, which `load_lamps` reads; `InputError` where it exists without `force`."""
        with whole_file(path, force) as partial:
            write_json(partial, self.record())
        return Path(path)

    def _readings(self) -> list[dict[str, Any]]:
        records = []
        for reading, strength in zip(self.readings, self.strengths, strict=True):
            known = {} if strength is None else {"intensity": strength.intensity.tolist(), **strength.record()}
            records.append(reading.record() | known)
        return records
