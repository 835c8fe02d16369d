"""lamps.json: calibrated lamps, as a capture lists them, with their standard errors."""

from __future__ import annotations

from typing import Annotated, Any

from hagoromo.files.record import ForeignRecord, WrittenBy, about, like
from hagoromo.photograph.transforms import LampRecord


class LampsRecord(ForeignRecord, frozen=True, kw_only=True):
    """lamps.json, as `calibrate lamps` writes it; other programs may write `lamps` only."""

    version_key = "hagoromo.format_version"
    takes_null = True

    lamps: Annotated[list[Annotated[dict[str, Any], like(LampRecord)]], about("the lamps, as a capture lists them")]
    ball: Annotated[dict[str, Any] | None, about("the first chrome ball: centre and radius in the image [px]")] = None
    balls: Annotated[list[dict[str, Any]], about("all chrome balls [px]")] = []
    spread: Annotated[dict[str, Any] | None, about("how well directions determine normals; null: not at all")] = None
    object: Annotated[dict[str, Any] | None, about("the object that took the place of a ball")] = None
    readings: Annotated[
        list[dict[str, Any]], about("each lamp with its standard errors [°], [m], and where its intensity comes from")
    ] = []
    hagoromo: Annotated[WrittenBy, about("what wrote the file")] = WrittenBy()
