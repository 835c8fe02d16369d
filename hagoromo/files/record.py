"""Records: TOML and JSON text as plain dictionaries, and the checks that each key passes.

A key is described by its kind, a function that returns the checked value or raises `ValueError` with what was wanted:

    take(table, {"voxel_size": positive, "name": (text, "box")}, "skin.toml [box]")

makes `voxel_size` required and gives `name` a default.
"""

from __future__ import annotations

import json
import math
import os
import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from hagoromo.errors import InputError
from hagoromo.files.door import read_bytes

Kind = Callable[[Any], Any]


def read_toml(path: str | Path) -> dict[str, Any]:
    """The tables of a TOML file; `InputError` when it is missing or no TOML."""
    try:
        return tomllib.loads(read_bytes(path).decode("utf-8"))
    except (UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise InputError(f"{path} is no TOML: {error}") from error


def read_json(path: str | Path) -> Any:
    """The object in a JSON file; `InputError` when it is missing, no JSON, or holds NaN or Infinity."""
    data = read_bytes(path)
    try:
        return json.loads(data.decode("utf-8-sig"), parse_constant=_refuse)
    except (UnicodeDecodeError, ValueError, RecursionError) as error:
        raise InputError(f"{path} is no JSON, it may be cut off: {error}") from error


def write_json(path: str | Path, record: Any) -> None:
    """Write `record` as indented JSON; `InputError` for NaN, Infinity or what JSON cannot hold."""
    try:
        text = json.dumps(record, indent=1, allow_nan=False, ensure_ascii=False)
    except (ValueError, TypeError) as error:
        raise InputError(f"{path} cannot be written: {error}") from error
    Path(path).write_text(text + "\n", encoding="utf-8")


def take(record: Any, spec: Mapping[str, Kind | tuple[Kind, Any]], where: str, strict: bool = True) -> dict[str, Any]:
    """The keys of `spec`, checked, with defaults filled in; a default is given as it is.

    spec: key → kind for a required key, (kind, default) for another. where: file and table, for the message.
    `InputError` for a missing key, a value not of its kind and, unless `strict` is off, an unknown key.
    """
    if not isinstance(record, Mapping):
        raise InputError(f"{where} must be a table of keys: given {_shown(record)}")
    unknown = [key for key in record if key not in spec]
    if unknown and strict:
        raise InputError(f"{where} has the unknown key {unknown[0]!r}: known are {', '.join(spec)}")
    taken = {}
    for key, entry in spec.items():
        kind, default = entry if isinstance(entry, tuple) else (entry, None)
        if key in record:
            taken[key] = _checked(kind, record[key], f"{where}: {key}")
        elif isinstance(entry, tuple):
            taken[key] = default
        else:
            raise InputError(f"{where} lacks the key {key!r}: add it")
    return taken


def inside(folder: str | Path, relative: str) -> Path:
    """`relative`, a path that a file in `folder` names; `InputError` when it leads out of `folder`."""
    path = os.path.normpath(relative)
    if os.path.isabs(path) or path == ".." or path.startswith(".." + os.sep):
        raise InputError(f"{relative!r} leads out of {folder}: give a path inside it")
    return Path(folder) / path


def number(value: Any) -> float:
    """A finite number."""
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise ValueError("a finite number")
    return float(value)


def positive(value: Any) -> float:
    """A finite number above 0."""
    if number(value) <= 0:
        raise ValueError("a number above 0")
    return float(value)


def count(value: Any) -> int:
    """A whole number, 0 or more."""
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        raise ValueError("a whole number, 0 or more")
    return value


def text(value: Any) -> str:
    """A string."""
    if not isinstance(value, str):
        raise ValueError("a text")
    return value


def flag(value: Any) -> bool:
    """True or false."""
    if not isinstance(value, bool):
        raise ValueError("true or false")
    return value


def table(value: Any) -> dict[str, Any]:
    """A table of keys, to be taken apart in its turn."""
    if not isinstance(value, dict):
        raise ValueError("a table of keys")
    return value


def anything(value: Any) -> Any:
    """A value that another door checks."""
    return value


def numbers(length: int | None = None) -> Kind:
    """Kind: a list of `length` finite numbers (of any length for None), given back as a tuple."""
    wanted = f"a list of {'' if length is None else f'{length} '}finite numbers"

    def check(value: Any) -> tuple[float, ...]:
        if not isinstance(value, (list, tuple)) or (length is not None and len(value) != length):
            raise ValueError(wanted)
        try:
            return tuple(number(entry) for entry in value)
        except ValueError as error:
            raise ValueError(wanted) from error

    return check


def one_of(*names: str) -> Kind:
    """Kind: one of `names`."""

    def check(value: Any) -> str:
        if not isinstance(value, str) or value not in names:
            raise ValueError("one of " + ", ".join(names))
        return value

    return check


def list_of(kind: Kind) -> Kind:
    """Kind: a list whose entries are each of `kind`."""

    def check(value: Any) -> list[Any]:
        if not isinstance(value, list):
            raise ValueError("a list")
        return [kind(entry) for entry in value]

    return check


def _checked(kind: Kind, value: Any, where: str) -> Any:
    try:
        return kind(value)
    except InputError:
        raise
    except ValueError as error:
        raise InputError(f"{where} must be {error}: given {_shown(value)}") from error


def _shown(value: Any) -> str:
    shown = repr(value)
    return shown if len(shown) <= 60 else shown[:57] + "..."


def _refuse(constant: str) -> None:
    raise ValueError(f"{constant} is no JSON number")
