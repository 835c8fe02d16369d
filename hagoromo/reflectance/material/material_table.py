"""A material in a TOML table: its parameters, or the name of a measured one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

from hagoromo.camera.response import Response
from hagoromo.errors import InputError, described
from hagoromo.files.checks import inside
from hagoromo.files.record import Record, about, decode, like, optional
from hagoromo.light.spectrum import SOURCE, Spectrum
from hagoromo.reflectance.element import Element
from hagoromo.reflectance.material.materials_file import read_materials
from hagoromo.reflectance.parameters import meaning
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.reflectance.reflectance_record import ReflectanceRecord, reflectance_from_record


class MeasuredMaterial(Record, frozen=True, kw_only=True):
    """A measured material, by its name in a materials.json."""

    file: Annotated[str, about("path of materials.json, inside the folder of this file")]
    material: Annotated[str, about("name of the material in it")]
    element: Annotated[Element | None, meaning("element", "; default: that of the place")] = None
    response: Annotated[str | None, about("camera response that it was measured with: a name or a CSV file")] = None
    lamp: Annotated[Any, SOURCE, about("spectrum of the lamps that it was measured under")] = 1.0
    transmission: Annotated[float, meaning("transmission", ": it is not measured")] = 0.0
    transmitted_colour: Annotated[Any, SOURCE, meaning("transmitted_colour")] = 1.0
    clearness: Annotated[float, meaning("clearness", ", 0…1")] = 0.0


MATERIAL = like(ReflectanceRecord, MeasuredMaterial)  # tables that `reflectance_from_table` accepts
PARTS = like(optional("MaterialParts", ReflectanceRecord))  # a table that overrides some parameters of another


def reflectance_from_table(
    record: dict[str, Any], folder: Path | None, where: str, element: Element = "plane"
) -> Reflectance:
    """A reflectance by its parameters, or a measured one: `{file = "materials.json", material = "silk"}`.

    A measured one may state the `response` and `lamp` spectrum that its body colour was measured with. Files lie inside
    `folder` (None: anywhere). `element` is used if the table has none.
    """
    if "file" not in record:
        return reflectance_from_record({"element": element, **record}, where, folder)
    table = decode(record, MeasuredMaterial, where)
    path = Path(table.file) if folder is None else inside(folder, table.file)
    estimates = {material.name: material for material in read_materials(path)}
    if table.material not in estimates:
        raise InputError(f"{where}: {path} has no material {table.material!r}: it has {', '.join(estimates)}")
    response = None if table.response is None else Response.load(table.response, folder)
    lamp = Spectrum.load(table.lamp, folder)
    measured = estimates[table.material].reflectance(response, lamp, table.element or element)
    if table.transmission == table.clearness == 0.0:
        return measured
    colour = Spectrum.load(table.transmitted_colour, folder)
    with described(where):
        passes = {"transmission": table.transmission, "clearness": table.clearness}
        return replace(measured, transmitted_colour=colour, **passes)
