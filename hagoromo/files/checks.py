"""Checks of paths and sizes before a file is opened or a large array is allocated."""

from __future__ import annotations

import os
from pathlib import Path

from hagoromo.errors import InputError

SHARE_OF_MEMORY = 0.9  # largest share of the free memory for one array; the rest is left for work on it


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
    check_memory(file.stat().st_size, str(file))
    return file.read_bytes()


def check_memory(size: float, what: str) -> None:
    """Raise `InputError` if `what`, which needs `size` bytes, does not fit into the free memory.

    Called before the memory is allocated.
    """
    free = free_memory()
    if not size <= SHARE_OF_MEMORY * free:
        raise InputError(
            f"{what} needs {size / 2**30:.3g} GiB of memory and {free / 2**30:.3g} GiB are free: make it smaller"
        )


def free_memory() -> int:
    """Free memory [bytes]; all physical memory where the system does not state the free memory."""
    pages = "SC_AVPHYS_PAGES" if "SC_AVPHYS_PAGES" in os.sysconf_names else "SC_PHYS_PAGES"
    try:
        for line in Path("/proc/meminfo").read_text().splitlines():
            if line.startswith("MemAvailable:"):
                return int(line.split()[1]) * 1024
    except OSError:
        pass  # not Linux
    return os.sysconf(pages) * os.sysconf("SC_PAGE_SIZE")
