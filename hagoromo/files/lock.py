"""Lock: one process at a time works in a folder; the lock of a process that died is free."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from hagoromo.errors import InputError


@contextmanager
def locked(path: Path, busy: str) -> Iterator[None]:
    """The file `path` is locked while the block runs, and removed at its end; it holds the number of the process.

    busy: what `InputError` says, with {pid} in it, while another process has it. The system frees the lock of a process
    that ends in any way, so none is ever left behind.
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
        os.close(file)  # its last holder has removed it meanwhile
    try:
        os.truncate(file, 0)
        os.pwrite(file, str(os.getpid()).encode("ascii"), 0)
        yield
    finally:
        path.unlink(missing_ok=True)
        os.close(file)


def _is(file: int, path: Path) -> bool:
    """Whether an open file is still the one at `path`."""
    try:
        return os.path.samestat(os.fstat(file), os.stat(path))
    except FileNotFoundError:
        return False
