"""TOML text of plain data, which `tomllib` reads back as the same data, its numbers to the last bit."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from typing import Any

BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")


def toml_text(record: Mapping[str, Any]) -> str:
    """The TOML of a record: its plain values, then a [table] or [[table]] for each of its tables and lists of them.

    Tables within tables stand in one line. Keys whose value is None are left out, as TOML has no such value.
    """
    plain = {key: value for key, value in record.items() if not _is_section(value)}
    parts = [_lines(plain)] if plain else []
    for key, value in record.items():
        if _is_section(value):
            head = f"[[{_key(key)}]]" if isinstance(value, (list, tuple)) else f"[{_key(key)}]"
            parts += [f"{head}\n{_lines(table)}" for table in (value if isinstance(value, (list, tuple)) else [value])]
    return "\n".join(parts)


def _is_section(value: Any) -> bool:
    """Whether a value is a table, or a list of tables."""
    if isinstance(value, (list, tuple)):
        return bool(value) and all(isinstance(entry, Mapping) for entry in value)
    return isinstance(value, Mapping)


def _lines(table: Mapping[str, Any]) -> str:
    return "".join(f"{_key(key)} = {toml_value(value)}\n" for key, value in table.items() if value is not None)


def _key(key: str) -> str:
    return key if BARE_KEY.fullmatch(key) else _text(key)


def _text(text: str) -> str:
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def toml_value(value: Any) -> str:
    """The TOML of one value, in one line."""
    if isinstance(value, Mapping):
        entries = (f"{_key(key)} = {toml_value(entry)}" for key, entry in value.items() if entry is not None)
        return "{" + ", ".join(entries) + "}"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(toml_value(entry) for entry in value) + "]"
    return _text(value) if isinstance(value, str) else json.dumps(value, allow_nan=False)
