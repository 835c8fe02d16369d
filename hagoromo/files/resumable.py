"""Resumable folder: the work of an interrupted run is kept and continued; the result appears complete or not at all."""

from __future__ import annotations

import errno
import os
import shutil
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from hagoromo.errors import InputError
from hagoromo.files.lock import locked
from hagoromo.files.whole import put_folder, replaceable_folder

FINGERPRINT_FILE = "recipe"  # file of the work folder: what is being made


@contextmanager
def resumable_folder(path: str | Path, fingerprint: str, force: bool = False) -> Iterator[Path]:
    """The folder to fill, `.NAME.building/whole` beside `path`; it is renamed to `path` when the block succeeds.

    It holds the work of an earlier, unfinished run if that had the same `fingerprint`; other work is removed. Its
    parent may hold a record of the progress. If the block fails, the work is kept and the exception says that the same
    command resumes it: `InputError` for an OSError such as a full disk, `KeyboardInterrupt` for Ctrl-C. After an
    `InputError` of the block the work is removed, because the same input would fail again. Also raises `InputError`
    where `whole_folder` does, and while another process makes the same folder.
    """
    target = replaceable_folder(path, force)
    work = target.absolute().with_name(f".{target.name}.building")
    target.parent.mkdir(parents=True, exist_ok=True)
    lock = work.with_name(work.name + ".lock")
    with locked(lock, f"{target} is being made by process {{pid}}: wait for it, or end it and run this again"):
        replaceable_folder(path, force)  # another process may have made it before this one had the lock
        _make_room(work, fingerprint)
        resume_hint = f"what is done is kept in {work}, the same command resumes it"
        try:
            yield work / "whole"
            put_folder(work / "whole", target)
        except KeyboardInterrupt as interrupt:
            raise KeyboardInterrupt(resume_hint) from interrupt
        except InputError:
            shutil.rmtree(work, ignore_errors=True)
            raise
        except OSError as error:
            raise InputError(f"{target}: {_advice(error)}; {resume_hint}") from error
        shutil.rmtree(work, ignore_errors=True)


def _make_room(work: Path, fingerprint: str) -> None:
    """Prepare the work folder: keep earlier work of the same `fingerprint`, remove any other."""
    recipe = work / FINGERPRINT_FILE
    if work.exists() and any(work.iterdir()) and not recipe.is_file():
        raise InputError(f"{work} holds files that Hagoromo did not write: move them")
    if recipe.is_file() and recipe.read_text() != fingerprint:
        warnings.warn(f"{work} held unfinished work on another recipe, which was removed", stacklevel=4)
        shutil.rmtree(work)
    if not recipe.exists():
        new = work.with_name(f"{work.name}.partial{os.getpid()}")
        new.mkdir()
        (new / FINGERPRINT_FILE).write_text(fingerprint)
        os.replace(new, work)  # so a work folder always has its recipe
    (work / "whole").mkdir(exist_ok=True)
    for partial in work.rglob("*.partial"):
        partial.unlink()


def _advice(error: OSError) -> str:
    full = error.errno in (errno.ENOSPC, errno.EDQUOT)
    return "the disk is full: free some space" if full else (error.strerror or str(error))
