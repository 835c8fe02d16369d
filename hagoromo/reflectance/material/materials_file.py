"""materials.json: the estimates of a capture's materials, a list with one table each."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from hagoromo.errors import InputError
from hagoromo.files.record import (
    anything,
    count,
    flag,
    list_of,
    number,
    numbers,
    one_of,
    read_json,
    table,
    take,
    text,
    write_json,
)
from hagoromo.files.whole import whole_file
from hagoromo.reflectance.element import ELEMENTS
from hagoromo.reflectance.material.material_estimate import PARAMETERS, MaterialEstimate

ESTIMATED = (*PARAMETERS, "specular_albedo", "body_colour")
MATERIAL = {
    "name": text,
    "pixels": count,
    "body_colour": numbers(),
    "interface_colour": numbers(),
    **dict.fromkeys((*PARAMETERS, "specular_albedo"), number),
    "element": (one_of(*ELEMENTS), "plane"),
    "standard_error": table,
    "interval_95": table,
    "correlation": list_of(list_of(anything)),
    "identifiable": table,
    "chi_square": number,
    "remarks": (list_of(text), ()),
    **dict.fromkeys(("lack_of_fit", "texture", "gloss"), (lambda value: None if value is None else table(value), None)),
}


def write_materials(materials: Sequence[MaterialEstimate], path: str | Path, force: bool = False) -> Path:
    """Write materials.json, whole or not at all: the fields of `MaterialEstimate`, null for None and for no bound."""
    with whole_file(path, force) as partial:
        write_json(partial, [_plain({key: getattr(material, key) for key in MATERIAL}) for material in materials])
    return Path(path)


def read_materials(path: str | Path) -> tuple[MaterialEstimate, ...]:
    """The estimates in the materials.json at `path`, as `hagoromo measure` writes it, in its order.

    `InputError` for a file that `write_materials` would not write; it names the material and the key.
    """
    record = read_json(path)
    if not isinstance(record, list):
        raise InputError(f"{path} must hold a list of materials: given {type(record).__name__}")
    return tuple(_material(entry, f"{path} material {i + 1}") for i, entry in enumerate(record))


def _material(entry: Any, where: str) -> MaterialEstimate:
    fields = take(entry, MATERIAL, where)
    known: dict[str, Any] = dict.fromkeys(ESTIMATED, (anything, None))
    channels = len(fields["body_colour"])
    errors = take(fields["standard_error"], known, f"{where}: standard_error")
    bounds = take(fields["interval_95"], known, f"{where}: interval_95")
    correlation = tuple(tuple(row) for row in fields["correlation"])
    if len(fields["interface_colour"]) != channels or {len(row) for row in correlation} != {len(PARAMETERS)}:
        raise InputError(f"{where}: colours must have one number a channel and the correlation {len(PARAMETERS)} rows")
    return MaterialEstimate(**{
        **fields,
        "correlation": correlation,
        "standard_error": {key: _tuples(value) for key, value in errors.items()},
        "interval_95": {key: _bounds(value, f"{where}: interval_95 {key}") for key, value in bounds.items()},
        "identifiable": take(fields["identifiable"], dict.fromkeys(PARAMETERS, flag), f"{where}: identifiable"),
        "remarks": tuple(fields["remarks"]),
    })  # fmt: skip


def _bounds(value: Any, where: str) -> tuple:
    """(low, high), or one such pair a channel; null is no bound."""
    if isinstance(value, list) and value and isinstance(value[0], list):
        return tuple(_bounds(pair, where) for pair in value)
    if not isinstance(value, list) or len(value) != 2:
        raise InputError(f"{where} must be two numbers: given {value!r:.60}")
    low, high = (None if bound is None else number(bound) for bound in value)
    return -math.inf if low is None else low, math.inf if high is None else high


def _tuples(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value


def _plain(value: Any) -> Any:
    """Mappings and sequences as JSON has them; what is not finite becomes null."""
    if isinstance(value, dict):
        return {key: _plain(entry) for key, entry in value.items()}
    if isinstance(value, (tuple, list)):
        return [_plain(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
