"""Moves within one file system that happen at once or not at all, and writes that outlast a loss of power.

Two names are exchanged by Linux's `renameat2` and macOS's `renamex_np`. Windows and some network file systems have no
such call.
"""

from __future__ import annotations

import ctypes
import errno
import functools
import os
import sys
from collections.abc import Callable
from pathlib import Path

NO_REPLACE, EXCHANGE = {"linux": (1, 2), "darwin": (4, 2)}.get(sys.platform, (0, 0))  # flags of the system's call
CANNOT = {errno.EINVAL, errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP}  # the file system has no such call
CANNOT_SYNC = {*CANNOT, errno.EBADF, errno.EACCES, errno.EPERM}


def exchange(one: Path, other: Path) -> bool:
    """Exchange two existing names at once; False, and nothing has changed, where the system cannot."""
    return _renamed(one, other, EXCHANGE)


def move_new(source: Path, target: Path) -> None:
    """Move `source` to `target`, where nothing may be: raises `FileExistsError` if there is something."""
    if _renamed(source, target, NO_REPLACE):
        return
    if os.path.lexists(target):
        raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(target))
    os.rename(source, target)


def sync(path: Path) -> None:
    """Wait until a file, or a folder with all that is in it, is on the disk."""
    if path.is_dir() and not path.is_symlink():
        with os.scandir(path) as entries:
            inside = [Path(entry.path) for entry in entries]
        for entry in inside:
            sync(entry)
    sync_one(path)


def sync_one(path: Path) -> None:
    """Wait until a file, or the list of names in a folder, is on the disk; nothing where the system cannot."""
    writable = os.name == "nt"  # there, only what is open for writing is synced, and no folder can be
    try:
        file = os.open(path, os.O_RDWR if writable else os.O_RDONLY | getattr(os, "O_NONBLOCK", 0))
    except OSError:
        if writable or path.is_symlink():
            return
        raise
    try:
        os.fsync(file)
    except OSError as error:
        if error.errno not in CANNOT_SYNC:
            raise
    finally:
        os.close(file)


def _renamed(source: Path, target: Path, flag: int) -> bool:
    """Whether the system's call with a flag moved `source`; False where there is none."""
    rename = _system_call()
    if rename is None:
        return False
    sys.audit("hagoromo.rename", str(source), str(target), flag)
    if rename(os.fsencode(source), os.fsencode(target), flag) == 0:
        return True
    number = ctypes.get_errno()
    if number in CANNOT:
        return False
    raise OSError(number, os.strerror(number), str(target))


@functools.cache
def _system_call() -> Callable[[bytes, bytes, int], int] | None:
    if not EXCHANGE:
        return None
    library = ctypes.CDLL(None, use_errno=True)
    if sys.platform == "darwin":
        named = getattr(library, "renamex_np", None)
        return named and (lambda source, target, flag: named(source, target, ctypes.c_uint(flag)))
    named = getattr(library, "renameat2", None)
    here = -100  # AT_FDCWD: relative paths start at the working folder
    return named and (lambda source, target, flag: named(here, source, here, target, ctypes.c_uint(flag)))
