"""Record keys: what a record says of the key at a path, such as warp.diameter_mm, and whether a table takes its value.

A record names by `like` the records of tables that are decoded later; here these are looked into, too.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import msgspec

from hagoromo.errors import InputError
from hagoromo.files.record import LATER, REFERENCE, decode

UNIT = re.compile(r"\[([^][]+)\]")
UNITS_OF_NAMES = {"_um": "µm", "_mm": "mm", "_deg": "°", "_per_cm": "1/cm", "_per_cm2": "1/cm²"}


def meaning_of_key(data: Mapping[str, Any], steps: Sequence[str], record: type, where: str) -> str:
    """What a record says of the key at `steps` through the tables `data`, which hold a value there; "" if nothing.

    Only tables on this way are checked. `InputError`, as of `decode`, for a key that a table does not know, which lists
    those it knows, and for a value that it does not take. where: what messages call the tables.
    """
    choices: list[type] = [record]
    meaning, table = "", data
    for number, step in enumerate(steps):
        _check(table, choices, where)
        fields = [field for choice in choices if (field := _fields(choice).get(step)) is not None]
        meaning = next((field["description"] for field in fields if "description" in field), "")
        choices = [LATER[name] for field in fields for name in _named(field) if name in LATER]
        inner = table[step]
        if number + 1 < len(steps):
            where = f"{where} [{step}]"
            if not isinstance(inner, Mapping):
                raise InputError(f"{where} is {inner!r:.40} and no table: it has no key {steps[number + 1]!r}")
            table = inner
    return meaning


def unit_of_key(key: str, meaning: str) -> str:
    """The unit of a key's value: in brackets in what a record says of it, or else as its name ends; "" without one.

    >>> unit_of_key("twist", "turns of the plies [1/cm]"), unit_of_key("scale_deg", ""), unit_of_key("n", "")
    ('1/cm', '°', '')
    """
    stated = UNIT.findall(meaning)
    if stated:
        return stated[-1]
    return named_unit(key)


def named_unit(key: str) -> str:
    """The unit that the name of a key ends in; "" of other keys."""
    return next((unit for end, unit in UNITS_OF_NAMES.items() if key.endswith(end)), "")


def _check(table: Mapping[str, Any], choices: list[type], where: str) -> None:
    """`InputError` unless one of the records takes the table; nothing is known of a table without records."""
    fitting = [choice for choice in choices if set(table) <= set(_fields(choice))] or choices[:1]
    errors: list[InputError] = []
    for choice in fitting:
        try:
            decode(table, choice, where)
            return
        except InputError as error:
            errors.append(error)
    if errors:
        raise errors[0]


def _fields(record: type) -> dict[str, Any]:
    """JSON Schema of each field, by its key."""
    _, tables = msgspec.json.schema_components([record], ref_template=REFERENCE + "{name}")
    return tables[record.__name__]["properties"]


def _named(field: Mapping[str, Any]) -> list[str]:
    """Names of the records that a field refers to."""
    return [choice["$ref"].removeprefix(REFERENCE) for choice in (field, *field.get("anyOf", [])) if "$ref" in choice]
