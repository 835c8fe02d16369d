"""A folder whose making may be cut off at any moment and taken up again; at its name it stands whole or not at all."""

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
    """The folder to fill, `.NAME.building/whole` beside `path`; it becomes `path` when the block ends well.

    The work of a run that failed or was killed is found there again if its `fingerprint` is the same, and removed if
    not; its parent is the place for a record of what is done. Where the block fails its work is kept, and the exception
    says that the same command goes on: `InputError` for an OSError such as a full disk, `KeyboardInterrupt` for Ctrl-C.
    An `InputError` of the block removes the work: the same input would fail again. `InputError`, too, for what
    `whole_folder` refuses, and while another process makes the same folder.
    """
    target = replaceable_folder(path, force)
    work = target.absolute().with_name(f".{target.name}.building")
    target.parent.mkdir(parents=True, exist_ok=True)
    lock = work.with_name(work.name + ".lock")
    with locked(lock, f"{target} is being made by process {{pid}}: wait for it, or end it and run this again"):
        replaceable_folder(path, force)  # it may have been made while the lock was another's
        _make_room(work, fingerprint)
        resume_hint = f"what is done is kept in {work}, the same command goes on from there"
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
    """The work folder, empty unless it holds the work on `fingerprint`."""
    recipe = work / FINGERPRINT_FILE
    if work.exists() and any(work.iterdir()) and not recipe.is_file():
        raise InputError(f"{work} holds files that Hagoromo did not write: move them")
    if recipe.is_file() and recipe.read_text() != fingerprint:
        warnings.warn(f"{work} held the unfinished work on another recipe: it was removed", stacklevel=4)
        shutil.rmtree(work)
    if not recipe.exists():
        new = work.with_name(f"{work.name}.partial{os.getpid()}")
        new.mkdir()
        (new / FINGERPRINT_FILE).write_text(fingerprint)
        os.replace(new, work)  # a work folder has its recipe from the first
    (work / "whole").mkdir(exist_ok=True)
    for partial in work.rglob("*.partial"):
        partial.unlink()


def _advice(error: OSError) -> str:
    full = error.errno in (errno.ENOSPC, errno.EDQUOT)
    return "the disk is full: free some space" if full else (error.strerror or str(error))
