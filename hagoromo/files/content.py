"""Content: what a file, a folder, or a TOML file with all that it names holds, as a short digest of its bytes."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from hagoromo.errors import InputError
from hagoromo.files.checks import inside
from hagoromo.files.record import read_toml

PIECE = 1 << 20  # bytes read at a time
DEEPEST = 8  # TOML files that name each other


def content(path: str | Path, quick: bool = False) -> str:
    """Digest of the file or folder at `path`: equal where names and bytes are; of nothing, "absent".

    quick: of files in folders only names and sizes are taken, so that a volume box is not read.
    """
    return _content(Path(path), quick)


def content_with_named(path: str | Path, quick: bool = False) -> str:
    """Digest of a TOML file and of every file and folder beside or under it that one of its texts names."""
    parts = [f"{name} {_content(file, quick)}" for name, file in sorted(set(_named(Path(path), "", DEEPEST)))]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def _named(toml: Path, prefix: str, deepest: int) -> Iterator[tuple[str, Path]]:
    yield prefix, toml
    for text in sorted(set(texts_of(read_toml(toml)))):
        try:
            path = inside(toml.parent, text)
            there = bool(text) and path != toml.parent and path.exists()
        except (InputError, OSError, ValueError):
            continue  # the text is no path
        if there and path.suffix == ".toml" and path.is_file() and deepest > 1:
            yield from _named(path, f"{prefix}/{text}", deepest - 1)
        elif there:
            yield f"{prefix}/{text}", path


def texts_of(value: Any) -> Iterator[str]:
    """All texts in a record of plain data, however deep."""
    pending = [value]
    while pending:
        entry = pending.pop()
        if isinstance(entry, str):
            yield entry
        elif isinstance(entry, (dict, list)):
            pending.extend(entry.values() if isinstance(entry, dict) else entry)


def _content(path: Path, quick: bool) -> str:
    if path.is_file():
        return _of_file(path)
    if not path.is_dir():
        return "absent"
    state = hashlib.sha256()
    for file in sorted(path.rglob("*")):
        if file.is_file():
            what = str(file.stat().st_size) if quick else _of_file(file)
            state.update(f"{file.relative_to(path).as_posix()}\0{what}\0".encode(errors="surrogateescape"))
    return state.hexdigest()


def _of_file(path: Path) -> str:
    state = hashlib.sha256()
    with path.open("rb") as file:
        while piece := file.read(PIECE):
            state.update(piece)
    return state.hexdigest()
