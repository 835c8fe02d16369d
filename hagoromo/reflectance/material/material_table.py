"""A material as a TOML table gives it: its figures, or the name of one that was measured."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from hagoromo.camera.response import Response
from hagoromo.errors import InputError
from hagoromo.files.record import anything, inside, one_of, take, text
from hagoromo.light.spectrum import Spectrum
from hagoromo.reflectance.element import ELEMENTS
from hagoromo.reflectance.material.materials_file import read_materials
from hagoromo.reflectance.reflectance import Reflectance, reflectance_from_record

MEASURED = {
    "file": text, "material": text, "element": (one_of(*ELEMENTS), None), "response": (text, None),
    "lamp": (anything, 1.0),
}  # fmt: skip


def reflectance_from_table(
    record: dict[str, Any], folder: Path | None, where: str, element: str = "plane"
) -> Reflectance:
    """A reflectance by its figures, or one that was measured: `{file = "materials.json", material = "silk"}`.

    A measured one may name the `response` and `lamp` spectrum that its body colour was measured with. Files lie inside
    `folder` (None: anywhere). `element` stands where the table names none.
    """
    if "file" not in record:
        return reflectance_from_record({"element": element, **record}, where, folder)
    key = take(record, MEASURED, where)
    path = Path(key["file"]) if folder is None else inside(folder, key["file"])
    found = {material.name: material for material in read_materials(path)}
    if key["material"] not in found:
        raise InputError(f"{where}: {path} has no material {key['material']!r}: it has {', '.join(found)}")
    response = None if key["response"] is None else Response.load(key["response"], folder)
    return found[key["material"]].reflectance(response, Spectrum.load(key["lamp"], folder), key["element"] or element)
