"""JSON Schema (2020-12) of a record: what editors complete and check a file by."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import msgspec

from hagoromo.files.record import LATER, REFERENCE

DIALECT = "https://json-schema.org/draft/2020-12/schema"


def record_schema(record: Any, title: str) -> dict[str, Any]:
    """The schema of a file that holds `record`, a record or a list of records.

    Tables that a later step decodes stand in `$defs` as well: see `hagoromo.files.record.like`.
    """
    (schema,), tables = msgspec.json.schema_components([record], ref_template=REFERENCE + "{name}")
    waiting = list(_named([schema, tables]))
    while waiting:
        name = waiting.pop()
        if name not in tables:
            _, more = msgspec.json.schema_components([LATER[name]], ref_template=REFERENCE + "{name}")
            new = {key: value for key, value in more.items() if key not in tables}
            tables |= new
            waiting.extend(_named(new))
    return {"$schema": DIALECT, "title": title, **schema, "$defs": {key: tables[key] for key in sorted(tables)}}


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
