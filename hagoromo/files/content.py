"""Content: what a file, a folder, or a TOML file with all that it names holds, as a short digest of its bytes."""

from __future__ import annotations

import hashlib
import json
import os
from collections import deque
from collections.abc import Container, Iterator
from pathlib import Path
from typing import Any

from hagoromo.errors import InputError
from hagoromo.files.checks import inside
from hagoromo.files.record import read_toml
from hagoromo.files.sources import sha256_of_file
from hagoromo.files.stores import address
from hagoromo.files.stores import state as state_in_store
from hagoromo.files.udim import MARK, udim_files

Named = tuple[str, Path]


def digest(record: Any) -> str:
    """Digest of plain data (what JSON holds): equal where its values are, whatever the order of its keys."""
    return hashlib.sha256(json.dumps(record, sort_keys=True).encode()).hexdigest()


def content(path: str | Path, quick: bool = False) -> str:
    """Digest of the file or folder at `path`: equal where names and bytes are; of nothing, "absent".

    quick: of files in folders only names and sizes are taken, so that a volume box is not read.
    """
    return _content(Path(path), quick)


def content_with_named(path: str | Path, quick: bool = False) -> str:
    """Digest of a TOML file and of every file and folder beside or under it that one of its texts names."""
    parts = [f"{name} {_content(file, quick)}" for name, file in sorted(set(named_by(Path(path))))]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def content_of_texts(tables: Any, folder: Path) -> dict[str, str]:
    """Digest of every file and folder in `folder` that a text of `tables` names, by the text."""
    named = {text: _named(folder, text, ()) for text in _with_tiles(folder, texts_of(tables))}
    return {text: _content(path, quick=False) for text, path in named.items() if path is not None}


def named_by(path: Path, awaited: Container[Path] = ()) -> Iterator[Named]:
    """`path` itself and, of a TOML file, what its texts name and these name in turn, each once with a label of its own.

    awaited: files and folders that count as named although they are not there yet, or not whole.
    """
    pending, seen = deque([("", path)]), {path}
    while pending:
        label, path = pending.popleft()
        yield label, path
        if (
            path.suffix != ".toml"
            or address(path)
            or not path.is_file()
            or any(place in awaited for place in (path, *path.parents))
        ):
            continue
        for text in sorted(set(_with_tiles(path.parent, texts_of(read_toml(path))))):
            named = _named(path.parent, text, awaited)
            if named is not None and named not in seen:
                seen.add(named)
                pending.append((f"{label}/{text}", named))


def _with_tiles(folder: Path, texts: Iterator[str]) -> Iterator[str]:
    """Texts, those that name tiles by UDIM as the files of these."""
    for text in texts:
        try:
            yield from udim_files(folder, text).values() if MARK in text else (text,)
        except (InputError, OSError, ValueError):
            yield text


def _named(folder: Path, text: str, awaited: Container[Path]) -> Path | None:
    """The file or folder inside `folder` that a text names; None where it names none."""
    try:
        if address(text):
            return Path(text)
        path = inside(folder, text)
        if not text or path == folder:
            return None
        return path if path.exists() or any(place in awaited for place in (path, *path.parents)) else None
    except (InputError, OSError, ValueError):
        return None  # the text is no path


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
    if address(path):
        return hashlib.sha256(state_in_store(path).encode()).hexdigest()
    if path.is_file():
        return sha256_of_file(path)
    if not path.is_dir():
        return "absent"
    state = hashlib.sha256()
    for file in sorted(path.rglob("*")):
        if file.is_file():
            what = (
                str(file.stat().st_size)
                if quick
                else _of_link(file, path)
                if file.is_symlink()
                else sha256_of_file(file)
            )
            state.update(f"{file.relative_to(path).as_posix()}\0{what}\0".encode(errors="surrogateescape"))
    return state.hexdigest()


def _of_link(link: Path, folder: Path) -> str:
    """Of a link in a folder: its file's, or, where it leads outside, what is known without opening that."""
    try:
        return sha256_of_file(inside(folder, link.relative_to(folder).as_posix()))
    except InputError:
        facts = link.stat()
        return f"{os.readlink(link)} {facts.st_size} {facts.st_mtime_ns}"
