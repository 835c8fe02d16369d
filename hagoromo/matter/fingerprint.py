"""Fingerprint of a recipe: equal for two recipes that build the same voxels."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from hagoromo import backend
from hagoromo.errors import InputError
from hagoromo.files.checks import inside
from hagoromo.version import __version__


def fingerprint(record: Mapping[str, Any], folder: Path | None) -> str:
    """JSON of the recipe with its seed, of the state of the files in `folder` that it names, of version and backend.

    The state of a file is its size and its time of last change. Raises `InputError` for values that JSON cannot hold.
    """
    named = {text: _state(folder, text) for text in sorted(set(_texts(record)))}
    files = {text: state for text, state in named.items() if state}
    known = {"recipe": record, "files": files, "version": __version__, "backend": backend.name()}
    try:
        return json.dumps(known, sort_keys=True)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"a box on disk needs a recipe of plain values: {error}") from error


def _texts(value: Any) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, (dict, list)):
        for entry in value.values() if isinstance(value, dict) else value:
            yield from _texts(entry)


def _state(folder: Path | None, text: str) -> list[Any]:
    """Path, size and time of the file `text`, or of all files in that folder; empty where neither exists."""
    try:
        path = Path(text) if folder is None else inside(folder, text)
        paths = [path] if path.is_file() else sorted(inner for inner in path.rglob("*") if inner.is_file())
    except (InputError, OSError, ValueError):
        return []  # the text is not a path
    return [[p.relative_to(path).as_posix(), p.stat().st_size, p.stat().st_mtime_ns] for p in paths]
