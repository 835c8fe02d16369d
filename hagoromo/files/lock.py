"""Lock: only one process at a time works in a folder; the lock of a process that ended is released."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from hagoromo.errors import InputError


@contextmanager
def locked(path: Path, busy: str) -> Iterator[None]:
    """Lock the file `path` while the block runs, and remove it at the end; it holds the number of the process.

    busy: message, with {pid} in it, of the `InputError` that is raised while another process holds the lock. The
    operating system releases the lock of a process that ends in any way.
    """
    while True:
        file = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            pid = os.read(file, 20).decode("ascii", "replace").strip()
            os.close(file)
            raise InputError(busy.format(pid=pid or "unknown")) from None
        if _is(file, path):
            break
        os.close(file)  # the process that held the lock has removed the file meanwhile
    try:
        os.truncate(file, 0)
        os.pwrite(file, str(os.getpid()).encode("ascii"), 0)
        yield
    finally:
        path.unlink(missing_ok=True)
        os.close(file)


def _is(file: int, path: Path) -> bool:
    """Whether an open file is still the file at `path`."""
    try:
        return os.path.samestat(os.fstat(file), os.stat(path))
    except FileNotFoundError:
        return False
