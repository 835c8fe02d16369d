"""Checks of paths and sizes before a file is opened or a large array is allocated."""

from __future__ import annotations

from pathlib import Path

from hagoromo.errors import InputError
from hagoromo.files.memory import require


def existing_file(path: str | Path) -> Path:
    """`path` as a `Path`; `InputError` when it is not an existing file."""
    file = Path(path)
    if file.is_dir():
        raise InputError(f"{file} is a folder: give a file")
    if not file.exists():
        raise InputError(f"{file} does not exist: check the path")
    return file


def existing_folder(path: str | Path) -> Path:
    """`path` as a `Path`; `InputError` when it is not an existing folder."""
    folder = Path(path)
    if not folder.exists():
        raise InputError(f"{folder} does not exist: check the path")
    if not folder.is_dir():
        raise InputError(f"{folder} is a file: give a folder")
    return folder


def read_bytes(path: str | Path) -> bytes:
    """All bytes of an existing file; its size is checked against the free memory first."""
    file = existing_file(path)
    require(file.stat().st_size, str(file))
    return file.read_bytes()
