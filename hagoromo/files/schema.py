"""JSON Schema (2020-12) of a record, by which editors complete and check a file."""

from __future__ import annotations

from collections.abc import Iterator
from inspect import cleandoc
from typing import Any, get_args

import msgspec

from hagoromo.files.record import LATER, REFERENCE, ForeignRecord

DIALECT = "https://json-schema.org/draft/2020-12/schema"


def record_schema(record: Any) -> dict[str, Any]:
    """The schema of a file that holds `record`, a record or a list of records.

    `$defs` also contains tables that a later step decodes: see `hagoromo.files.record.like`.
    """
    (schema,), tables = msgspec.json.schema_components([record], ref_template=REFERENCE + "{name}")
    waiting = list(_named([schema, tables]))
    while waiting:
        name = waiting.pop()
        if name not in tables:
            _, more = msgspec.json.schema_components([LATER[name]], ref_template=REFERENCE + "{name}")
            waiting.extend(_named(more))
            tables |= {key: value for key, value in more.items() if key not in tables}
    (entry,) = get_args(record) or (record,)
    title = (entry.__doc__ or "").splitlines()[0].rstrip(".")
    takes_null = {one.__name__ for one in _records(ForeignRecord) if one.takes_null}
    for name, table in tables.items():
        if "description" in table:
            table["description"] = cleandoc(table["description"])  # Python 3.13 does so by itself
        for key, field in table["properties"].items():
            table["properties"][key] = _as_decoded(field, name in takes_null)
    return {"$schema": DIALECT, "title": title, **schema, "$defs": {key: tables[key] for key in sorted(tables)}}


def _as_decoded(field: dict[str, Any], takes_null: bool) -> dict[str, Any]:
    """The schema of a field as `decode` reads it: null only where it is allowed; a choice without its pattern."""
    if "enum" in field:
        field.pop("pattern", None)
    if takes_null or field.get("default", ...) is not None:
        return field
    known = {key: value for key, value in field.items() if key not in ("anyOf", "default")}
    choices = [_as_decoded(choice, False) for choice in field.get("anyOf", []) if choice.get("type") != "null"]
    return known | (choices[0] if len(choices) == 1 else {"anyOf": choices} if choices else {})


def _records(base: type) -> Iterator[Any]:
    for record in base.__subclasses__():
        yield record
        yield from _records(record)


def _named(part: Any) -> Iterator[str]:
    """The names of the tables that a part of a schema refers to."""
    if isinstance(part, dict):
        if isinstance(part.get("$ref"), str):
            yield part["$ref"].removeprefix(REFERENCE)
        for value in part.values():
            yield from _named(value)
    elif isinstance(part, list):
        for value in part:
            yield from _named(value)
