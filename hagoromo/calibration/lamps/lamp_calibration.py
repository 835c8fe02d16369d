"""LampCalibration: the lamps calibrated with chrome balls, their errors, and their file, lamps.json."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from hagoromo.calibration.lamps.ball import Ball
from hagoromo.calibration.lamps.highlight import DISPUTES, Highlight
from hagoromo.calibration.lamps.place import LampPlace
from hagoromo.calibration.lamps.reading import LampReading, Strength
from hagoromo.errors import InputError
from hagoromo.files.record import (
    Count,
    ForeignRecord,
    Pair,
    Positive,
    Vector,
    about,
    decode,
    one_of,
    read_json,
    save_json,
    written_by,
)
from hagoromo.least_squares.fit_status import FitStatus, Status
from hagoromo.light.lamp import Lamp
from hagoromo.light.lamp_spread import LampSpread
from hagoromo.photograph.lamp_files import LampsRecord

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


class FitRecord(ForeignRecord, frozen=True, kw_only=True):
    """How a fit ended; null where a number is not known."""

    status: Annotated[str, one_of(*(each.words for each in Status)), about("how it ended")]
    steps: Annotated[Count, about("steps that it took")]
    cost: Annotated[float | None, about("½ χ² at the end")] = None
    gradient: Annotated[float | None, about("norm of its gradient there")] = None
    last_step: Annotated[float | None, about("size of the last step")] = None


class BallEntry(ForeignRecord, frozen=True, kw_only=True):
    """A chrome ball."""

    centre_px: Annotated[Pair, about("centre of its outline [px]")]
    radius_px: Annotated[Positive, about("radius [px]")]
    standard_error_px: Annotated[Vector, about("of both coordinates of the centre, and of the radius [px]")]
    rms_px: Annotated[float, about("distance of the edge from the outline [px]")]
    outline: Annotated[str, about("what it was found in")] = "mask"
    centre_from_mask_px: Annotated[Pair, about("offset from the mask's centre [px]")] = (0.0, 0.0)
    softness_px: Annotated[float | None, about("blur of the edge [px]")] = None
    edge_share: Annotated[float | None, about("share of a mask's outline that the photographs show")] = None


class ReadingEntry(ForeignRecord, frozen=True, kw_only=True):
    """A lamp on a ball."""

    name: Annotated[str, about("of the lamp")]
    to_lamp: Annotated[Vector, about("direction to it")]
    standard_error_deg: Annotated[float, about("of the direction [°]")]
    highlight_px: Annotated[Pair, about("where the ball shows it [px]")]
    highlight_standard_error_px: Annotated[float, about("of that place [px]")]
    rival: Annotated[float, about("ratio of the second brightest spot to this one")]
    highlight_from: Annotated[str, about("how it was located")] = "ellipse"
    dispute: Annotated[str, one_of("", *DISPUTES), about("what has it elsewhere")] = ""
    disputed_px: Annotated[Pair | None, about("where that has it [px]")] = None
    from_shading_deg: Annotated[float | None, about("angle to the direction by the ball's shading [°]")] = None


class PlaceEntry(ForeignRecord, frozen=True, kw_only=True):
    """A lamp located by several balls."""

    name: Annotated[str, about("of the lamp")]
    to_lamp: Annotated[Vector | None, about("direction to a far lamp")] = None
    position: Annotated[Vector | None, about("place of a near lamp [m]")] = None
    covariance_m2: Annotated[tuple[Vector, Vector, Vector] | None, about("of the place [m²]")] = None
    standard_error_deg: Annotated[float, about("of the direction [°]")]
    inverse_distance_per_m: Annotated[float, about("one over the distance [1/m]")]
    inverse_distance_error_per_m: Annotated[float, about("its standard error [1/m]")]
    misfit: Annotated[float, about("root mean square of the rays' misses over their errors")]
    balls: Annotated[list[ReadingEntry], about("the lamp on each ball")]


class ShadingEntry(ForeignRecord, frozen=True, kw_only=True):
    """A direction from a matte ball."""

    to_lamp: Annotated[Vector, about("direction")]
    standard_error_deg: Annotated[float, about("of it [°]")]


class StrengthEntry(ForeignRecord, frozen=True, kw_only=True):
    """The strength of a lamp."""

    intensity: Annotated[float | tuple[float, ...], about("of each channel")]
    intensity_standard_error: Annotated[float | tuple[float, ...], about("of each channel")]
    intensity_from: Annotated[str, about("what it was measured on")]
    intensity_scatter: Annotated[float, about("deviation of the residuals over the brightest value")]
    shading: Annotated[ShadingEntry | None, about("what a matte ball says of the direction")] = None
    intensity_convergence: Annotated[list[FitRecord], about("how the fits ended")] = []


class SpreadEntry(ForeignRecord, frozen=True, kw_only=True):
    """How far the directions are spread."""

    lamps: Annotated[Count, about("how many there are")]
    condition: Annotated[float, about("largest over smallest singular value")]
    widest_deg: Annotated[float, about("largest angle between two [°]")]


class ObjectEntry(ForeignRecord, frozen=True, kw_only=True):
    """The object that took the place of a ball."""

    convex: Annotated[float, about("share of its outline that is convex")]
    ambiguity: Annotated[str, about("what its photographs leave open")]
    integrability: Annotated[float, about("residual of integrability")]
    condition: Annotated[float, about("condition of the fit")]
    convergence: Annotated[dict[str, FitRecord], about("how the fits ended")] = {}


class LampOfObject(ForeignRecord, frozen=True, kw_only=True):
    """A lamp by an object."""

    name: Annotated[str, about("of the lamp")]
    to_lamp: Annotated[Vector, about("direction to it")]
    intensity: Annotated[tuple[float, ...], about("of each channel")]
    standard_error_deg: Annotated[float, about("of the direction [°]")]
    intensity_relative_error: Annotated[float, about("standard error of the intensity over it")]


def check_of_balls(record: LampsRecord, where: str) -> None:
    """`InputError` where an entry of a lamps.json of chrome balls has another type than its readers take."""
    for k, ball in enumerate(record.balls):
        decode(_known(ball), BallEntry, f"{where}: balls[{k}]")
    for k, reading in enumerate(record.readings):
        place = f"{where}: readings[{k}]"
        decode(_known(reading), PlaceEntry if "balls" in reading else ReadingEntry, place)
        if "intensity_from" in reading:
            decode(_known(reading), StrengthEntry, place)
    if record.spread is not None:
        decode(record.spread, SpreadEntry, f"{where}: spread")


def check_of_object(record: LampsRecord, where: str) -> None:
    """The same for a lamps.json of an object."""
    if record.object is not None:
        decode(_known(record.object), ObjectEntry, f"{where}: object")
    for k, reading in enumerate(record.readings):
        decode(reading, LampOfObject, f"{where}: readings[{k}]")


def _known(entry: Mapping[str, Any]) -> dict[str, Any]:
    """An entry without what is null: not known."""
    return {key: value for key, value in entry.items() if value is not None}
