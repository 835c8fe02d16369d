"""Outputs written whole or not at all: a temporary name beside the target, renamed on success.

Failure and Ctrl-C alike remove the temporary; the target is then as it was.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from hagoromo.errors import InputError

MARK = ".hagoromo"  # an empty file in every folder written here; without it a folder is never replaced


@contextmanager
def whole_file(path: str | Path, force: bool = False) -> Iterator[Path]:
    """Temporary path, with the suffix of `path`, to write to; it becomes `path` when the block ends without exception.

    `InputError` when `path` exists without `force`, or is a folder.
    """
    target = Path(path)
    if target.is_dir():
        raise InputError(f"{target} is a folder: give a file name")
    if target.exists() and not force:
        raise InputError(f"{target} exists: choose another name or add --force")
    target.parent.mkdir(parents=True, exist_ok=True)
    partial = _partial(target)
    try:
        yield partial
        os.replace(partial, target)
    finally:
        partial.unlink(missing_ok=True)


@contextmanager
def whole_folder(path: str | Path, force: bool = False) -> Iterator[Path]:
    """Temporary empty folder to fill; it becomes `path` when the block ends without exception.

    `InputError` when `path` exists and is not empty without `force`; with `force`, when it was not written by
    Hagoromo (a folder of somebody else's files is never deleted).
    """
    target = Path(path)
    if target.exists() and not target.is_dir():
        raise InputError(f"{target} is a file: give a folder name")
    if target.exists() and any(target.iterdir()):
        if not force:
            raise InputError(f"{target} exists: choose another name or add --force")
        if not (target / MARK).exists():
            raise InputError(f"{target} holds files that Hagoromo did not write: choose another name")
    target.parent.mkdir(parents=True, exist_ok=True)
    partial = _partial(target)
    partial.mkdir()
    try:
        yield partial
        (partial / MARK).touch()
        _replace_folder(partial, target)
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def _partial(target: Path) -> Path:
    return target.absolute().with_name(f".{target.stem}.partial{os.getpid()}{target.suffix}")


def _replace_folder(partial: Path, target: Path) -> None:
    """Rename `partial` to `target`; what stood there is moved aside first and removed last."""
    if not target.exists():
        os.replace(partial, target)
        return
    old = partial.with_name(partial.name + ".old")
    os.replace(target, old)
    try:
        os.replace(partial, target)
    except BaseException:
        os.replace(old, target)
        raise
    shutil.rmtree(old)
