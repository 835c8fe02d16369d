"""Lock: only one process at a time writes a target; the lock of a process that ended, in any way, is released."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from hagoromo.errors import InputError

PATIENCE_S = 0.2  # for a process that only looks at leftovers, so that of two that begin at once one wins
POLL_S = 0.01


@contextmanager
def locked(path: Path, busy: str) -> Iterator[None]:
    """Lock the file `path` while the block runs, and remove it at the end; it holds the number of the process.

    busy: message, with {pid} in it, of the `InputError` that is raised while another process (or thread) holds the
    lock. The number is for people: whether the lock is held is known to the operating system alone.
    """
    import filelock

    lock = filelock.FileLock(path, timeout=PATIENCE_S, thread_local=False)
    try:
        lock.acquire(poll_interval=POLL_S)
    except filelock.Timeout:
        raise InputError(busy.format(pid=_holder(path))) from None
    soft = isinstance(lock, filelock.SoftFileLock)  # on a file system without locks: the file itself is the lock
    try:
        if not soft:
            with suppress(OSError):  # a full disk, or a system that lets nobody write to a locked file
                path.write_text(str(os.getpid()), encoding="ascii")
        yield
    finally:
        if os.name != "nt" and not soft:
            path.unlink(missing_ok=True)  # while it is held: who waits for it notices that it is gone
        lock.release()
        if os.name == "nt":
            with suppress(OSError):  # another process may hold it by now
                path.unlink()


def _holder(path: Path) -> str:
    """The number of the process that holds the lock."""
    with suppress(OSError, ValueError):
        return str(int(path.read_text(encoding="ascii", errors="replace")))
    return "unknown"
