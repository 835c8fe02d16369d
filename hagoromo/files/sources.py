"""Sources: what a result was made from, each file by its name and SHA-256, stated in the table `hagoromo` of results.

A command has the files that it is given; in a program, `made_from` says which they are.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Any

from hagoromo.files.stores import address
from hagoromo.files.whole import MARK

MOST = 10_000  # files; more are not stated one by one
OF_BOX = "zarr.json"  # of a volume box, which has the recipe that it was built from
_given: ContextVar[tuple[Path, ...]] = ContextVar("given", default=())
_known: dict[tuple[Path, int, int], str] = {}  # file, size [byte] and time of its last change → digest


@contextmanager
def made_from(files: Sequence[str | Path]) -> Iterator[None]:
    """Results that are written in here state these files and folders as their sources.

    >>> with made_from(["cup.json"]):  # it is not there
    ...     sources()
    []
    """
    before = _given.set(tuple(Path(file) for file in files))
    try:
        yield
    finally:
        _given.reset(before)


def sources() -> list[dict[str, Any]]:
    """The sources of a result that is written now: `name`, with the folder that was given, and `sha256`.

    Of a folder that this package wrote they are its records (JSON), which state their own sources; of another one its
    files. What is not there, or in a store, is left out.
    """
    found: dict[Path, str] = {}
    for path in _given.get():
        for file, name in _files(path):
            found.setdefault(file, name)
    if len(found) > MOST:
        return []
    return [{"name": name, "sha256": digest_of_file(file)} for file, name in found.items()]


def digest_of_file(path: Path) -> str:
    """SHA-256 of a file, hexadecimal; read once as long as it does not change."""
    facts = path.stat()
    key = path.resolve(), facts.st_size, facts.st_mtime_ns
    if key not in _known:
        _known[key] = sha256_of_file(path)
    return _known[key]


def sha256_of_file(path: Path) -> str:
    """SHA-256 of the bytes of a file, hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _files(path: Path) -> Iterator[tuple[Path, str]]:
    """Files that stand for a path, and their names."""
    if address(path) is not None:
        return
    if path.is_file():
        yield path, path.name
    elif (path / OF_BOX).is_file():
        yield path / OF_BOX, f"{path.resolve().name}/{OF_BOX}"
    elif path.is_dir():
        files = sorted(file for file in path.iterdir() if file.is_file() and not file.name.startswith("."))
        if (path / MARK).exists():  # a folder of this package
            files = [file for file in files if file.suffix == ".json"]
        yield from ((file, f"{path.resolve().name}/{file.name}") for file in files)
