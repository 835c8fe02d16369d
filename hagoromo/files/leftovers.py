"""Leftovers: what a process that was killed left beside its target is completed, put back or removed.

While a target NAME is written there are beside it `.NAME.lock`, which the writer holds, and `.NAME.writing`, the work
folder with what is not whole yet; `.NAME.building` is that of a build that can be resumed. Who holds the lock knows
that the writer of anything else there has ended, whatever its number was.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Container, Iterator
from contextlib import contextmanager, suppress
from hashlib import blake2b
from pathlib import Path

from hagoromo.errors import InputError
from hagoromo.files.exchange import sync, sync_one

MARK = ".hagoromo"  # empty file in every folder that this package writes; only such folders are replaced or removed
COMMIT = "commit"  # file of a work folder: names of the files in it that are whole and shall replace those beside it
GROUP = "group"  # file of a work folder: name of the target whose work folder holds the file of this target
OLD = "old"  # in a work folder: what was at the target, where the system cannot exchange two names at once
BUILT = "whole"  # in the work folder of a build: the folder that is filled
BUILT_NUMBER = "whole.inode"  # file of the work folder of a build: inode of BUILT when it was made
LONGEST_NAME = 255  # bytes
PATIENCE_S = 0.2  # for a process that only looks at leftovers, so that of two that begin at once one wins
POLL_S = 0.01


def beside(target: Path, what: str) -> Path:
    """The hidden name beside `target` of its "lock", its "writing" or its "building"."""
    name = f".{target.name}.{what}"
    if len(os.fsencode(name)) > LONGEST_NAME:
        name = f".{blake2b(os.fsencode(target.name), digest_size=16).hexdigest()}.{what}"
    return target.with_name(name)


@contextmanager
def alone(target: Path, mine: Container[Path] = ()) -> Iterator[None]:
    """Hold the lock of `target` while the block runs; what a killed process left of it is dealt with first.

    mine: other targets whose locks are held. `InputError` while another process writes `target`.
    """
    busy = f"{target} is being written by process {{pid}}: wait for it, or end it and run this again"
    with locked(beside(target, "lock"), busy):
        _recover(target, mine)
        yield


def tidy(target: Path) -> None:
    """Clean up after a process that was killed while it wrote `target`; `InputError` while another one writes it."""
    if any(os.path.lexists(beside(target, what)) for what in ("lock", "writing", "building")):
        with alone(target):
            pass


def begin_work(work: Path) -> Path:
    """Make the work folder `work`, marked as Hagoromo's; it is empty."""
    work.mkdir(exist_ok=True)
    (work / MARK).touch()
    return work


def commit(work: Path, names: list[str]) -> None:
    """Let the files `names` of `work` replace those beside it, one after the other.

    All of them do or none: when the process is killed in between, the next to write one of them completes it.
    """
    sync(work)
    partial = work / (COMMIT + ".partial")
    partial.write_text(json.dumps(names), encoding="utf-8")
    sync_one(partial)
    os.replace(partial, work / COMMIT)
    sync_one(work)
    finish(work)


def finish(work: Path) -> None:
    """Complete what `commit` began, if it did."""
    listed = work / COMMIT
    if not listed.is_file():
        return
    for name in _listed(listed):
        if (work / name).is_file():
            os.replace(work / name, work.with_name(name))
    sync_one(work.parent)
    listed.unlink()


def _listed(commit: Path) -> list[str]:
    """The names in a list of `commit`; none of a damaged one, or one that names other folders."""
    try:
        names = json.loads(commit.read_text(encoding="utf-8"))
    except (ValueError, RecursionError):
        return []
    named = [name for name in names if isinstance(name, str)] if isinstance(names, list) else []
    return [name for name in named if name not in ("", ".", "..") and Path(name).name == name and "\0" not in name]


def remove_work(work: Path) -> None:
    """Remove a work folder; its mark goes last, so that what is left when this is cut off is still known as work.

    What cannot be removed, such as a file that is open on Windows, is left to the next who writes the target.
    """
    if not work.is_dir() or (work / COMMIT).exists():
        return
    with suppress(OSError):
        with suppress(OSError):  # a full disk
            (work / MARK).touch()
        for entry in sorted(work.iterdir(), key=lambda entry: entry.name != "recipe"):
            if entry.name == MARK:
                continue
            if entry.is_dir() and not entry.is_symlink():
                shutil.rmtree(entry, ignore_errors=True)
            else:
                entry.unlink(missing_ok=True)
        if set(os.listdir(work)) <= {MARK}:
            (work / MARK).unlink(missing_ok=True)
            work.rmdir()


def check_work(work: Path, known: str = MARK) -> None:
    """Raise `InputError` where `work` is there and holds files that Hagoromo did not write."""
    if not os.path.lexists(work):
        return
    if work.is_symlink() or not work.is_dir() or (any(work.iterdir()) and not {MARK, known} & set(os.listdir(work))):
        raise InputError(f"{work} holds files that Hagoromo did not write: move them")


def number_built(work: Path) -> None:
    """Note in the work folder of a build which folder it fills."""
    (work / BUILT_NUMBER).write_text(str((work / BUILT).stat().st_ino), encoding="ascii")


def holds_other(work: Path) -> bool:
    """Whether the folder in the work of a build is not the one that was filled: it was exchanged for the target's."""
    try:
        return (work / BUILT_NUMBER).read_text(encoding="ascii") != str((work / BUILT).stat().st_ino)
    except FileNotFoundError:
        return (work / BUILT_NUMBER).exists()


def _recover(target: Path, mine: Container[Path]) -> None:
    work, build = beside(target, "writing"), beside(target, "building")
    if os.path.lexists(work):
        check_work(work)
        _recover_group(work, mine)
        finish(work)
        if (work / OLD).exists() and not target.exists():
            os.replace(work / OLD, target)
        remove_work(work)
    removed = (build / MARK).exists() and not (build / "recipe").exists()
    if build.is_dir() and (removed or holds_other(build)):
        remove_work(build)  # it was being removed, or its box is at its place


def _recover_group(work: Path, mine: Container[Path]) -> None:
    """Where the file of this target lies in the work folder of another: deal with that one."""
    if not (work / GROUP).is_file():
        return
    name = (work / GROUP).read_text(encoding="utf-8")
    if name and name == Path(name).name and work.with_name(name) not in mine:
        with alone(work.with_name(name)):
            pass


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
