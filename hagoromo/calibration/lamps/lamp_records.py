"""The entries of lamps.json about balls, readings and strengths: types that a file must have to be read back."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from hagoromo.calibration.lamps.highlight import DISPUTES
from hagoromo.files.record import Count, ForeignRecord, Pair, Positive, Vector, about, decode, one_of
from hagoromo.least_squares.fit_status import Status
from hagoromo.photograph.lamps_file import LampsRecord


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
