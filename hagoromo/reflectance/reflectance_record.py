"""The record of a reflectance, as files and tables of recipes and scenes hold it, and the reflectance of a record."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from msgspec import Meta, defstruct

from hagoromo.errors import described
from hagoromo.files.record import Record, decode, like
from hagoromo.light.spectrum import SOURCE, Spectrum, SpectrumRecord
from hagoromo.reflectance.element import Element
from hagoromo.reflectance.facets import GAUSSIAN, TailExponent
from hagoromo.reflectance.parameters import PLAIN_BODY, STATED, meaning
from hagoromo.reflectance.pigment import PigmentRecord, pigment_from_record, skin_colour
from hagoromo.reflectance.reflectance import MOST_LOBES, NEUTRAL, Lobe, Reflectance

if TYPE_CHECKING:
    NumbersRecord = Record
else:
    OF_ALPHA = {"alpha": "; 1/π: body_colour is the albedo"}
    NumbersRecord = defstruct(
        "NumbersRecord",
        [
            *((key, Annotated[float, meaning(key, "; of planes only")], plain) for key, plain in PLAIN_BODY.items()),
            *((key, Annotated[float, meaning(key, OF_ALPHA.get(key, ""))]) for key in STATED),
        ],
        bases=(Record,),
        frozen=True,
        kw_only=True,
    )


class ReflectanceRecord(NumbersRecord, frozen=True, kw_only=True):
    """A reflectance by its parameters: dichromatic Torrance–Sparrow."""

    nu: Annotated[TailExponent | None, meaning("nu", "; absent: Gaussian facets")] = None
    lobes: Annotated[tuple[Lobe, ...], Meta(max_length=MOST_LOBES), meaning("lobes", ", each [β, γ]")] = ()
    body_colour: Annotated[
        Any,
        like(PigmentRecord, SpectrumRecord, number={"type": "number"}, name={"type": "string"}),
        meaning("body_colour", ": a number, a CSV file, a spectrum, or the pigments of skin"),
    ]
    interface_colour: Annotated[
        Any, SOURCE, meaning("interface_colour", ": a number, a CSV file or a spectrum; 1: as the lamp")
    ] = 1.0
    transmission: Annotated[float, meaning("transmission", " and leaves by its far side, 0…1")] = 0.0
    transmitted_colour: Annotated[Any, SOURCE, meaning("transmitted_colour", "; absent: body_colour")] = None
    clearness: Annotated[float, meaning("clearness", ", as through clear fibres, 0…1; of cylinders")] = 0.0
    element: Annotated[Element, meaning("element")] = "plane"
    name: Annotated[str, meaning("name")] = ""


def reflectance_from_record(record: Any, where: str, folder: str | Path | None = None) -> Reflectance:
    """A Reflectance from a table as `ReflectanceRecord` has it, its colours as `Spectrum.load` takes them.

    Gaussian facets: `nu` is absent, null or infinity.

    The body colour may be that of skin, by its pigments: `{melanin = 0.03, blood = 0.01, oxygenation = 0.8}`.
    """
    colour = lambda source: Spectrum.load(source, folder)  # noqa: E731

    def body(source: Any) -> Spectrum:
        by_pigment = isinstance(source, Mapping) and not source.keys() & {"wavelengths", "values"}
        return skin_colour(pigment_from_record(source, f"{where}: body_colour")) if by_pigment else colour(source)

    given = decode(_without_gaussian_nu(record), ReflectanceRecord, where)
    values = {each.name: getattr(given, each.name) for each in fields(Reflectance)}
    with described(where):
        values["nu"] = GAUSSIAN if given.nu is None else given.nu
        values["body_colour"] = body(given.body_colour)
        values["interface_colour"] = NEUTRAL if given.interface_colour == 1.0 else colour(given.interface_colour)
        values["transmitted_colour"] = None if given.transmitted_colour is None else colour(given.transmitted_colour)
        return Reflectance(**values)


def _without_gaussian_nu(record: Any) -> Any:
    """The table without a `nu` that says Gaussian facets: null or infinity."""
    if isinstance(record, Mapping) and "nu" in record and record["nu"] in (None, GAUSSIAN):
        return {key: value for key, value in record.items() if key != "nu"}
    return record
