"""Outputs that appear complete or not at all: written under a temporary name and renamed on success.

After a failure or Ctrl-C the temporary file is removed and the target is unchanged.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from hagoromo.errors import InputError

MARK = ".hagoromo"  # empty file in every folder that this package writes; only such folders are replaced


@contextmanager
def whole_file(path: str | Path, force: bool = False) -> Iterator[Path]:
    """Temporary path, with the suffix of `path`, to write to; renamed to `path` when the block succeeds.

    `InputError` if `path` exists without `force`, or is a folder.
    """
    target = replaceable_file(path, force)
    target.parent.mkdir(parents=True, exist_ok=True)
    partial = _partial(target)
    try:
        yield partial
        os.replace(partial, target)
    finally:
        partial.unlink(missing_ok=True)


@contextmanager
def whole_folder(path: str | Path, force: bool = False) -> Iterator[Path]:
    """Temporary empty folder to fill; renamed to `path` when the block succeeds.

    `InputError` if `path` is a non-empty folder without `force`; with `force`, if Hagoromo did not write it (other
    files are never deleted).
    """
    target = replaceable_folder(path, force)
    target.parent.mkdir(parents=True, exist_ok=True)
    partial = _partial(target)
    partial.mkdir()
    try:
        yield partial
        put_folder(partial, target)
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def replaceable_file(path: str | Path, force: bool = False) -> Path:
    """`path`, if a file may be written there; raises `InputError` as `whole_file` does."""
    target = Path(path)
    if target.is_dir():
        raise InputError(f"{target} is a folder: give a file name")
    if target.exists() and not force:
        raise InputError(f"{target} exists: choose another name or add force (--force)")
    return target


def replaceable_folder(path: str | Path, force: bool = False) -> Path:
    """`path`, if a folder may be written there; raises `InputError` as `whole_folder` does."""
    target = Path(path)
    if target.exists() and not target.is_dir():
        raise InputError(f"{target} is a file: give a folder name")
    if target.exists() and any(target.iterdir()):
        if not force:
            raise InputError(f"{target} exists: choose another name or add force (--force)")
        if not (target / MARK).exists():
            raise InputError(f"{target} holds files that Hagoromo did not write: choose another name")
    return target


def put_folder(whole: Path, target: Path) -> None:
    """Mark the folder `whole` as Hagoromo's and rename it to `target`; an old folder there is removed last."""
    (whole / MARK).touch()
    if not target.exists():
        os.replace(whole, target)
        return
    old = _partial(target).with_suffix(".old")
    os.replace(target, old)
    try:
        os.replace(whole, target)
    except BaseException:
        os.replace(old, target)
        raise
    shutil.rmtree(old)


def _partial(target: Path) -> Path:
    return target.absolute().with_name(f".{target.stem}.partial{os.getpid()}{target.suffix}")
