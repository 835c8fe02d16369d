"""Resumable folder: the work of an interrupted run is kept and continued; the result appears complete or not at all."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from hagoromo.errors import InputError
from hagoromo.files.exchange import sync_one
from hagoromo.files.leftovers import (
    BUILT,
    MARK,
    alone,
    begin_work,
    beside,
    check_work,
    holds_other,
    number_built,
    remove_work,
)
from hagoromo.files.whole import FULL, check_folder, holding, names_written, parents_of, put_folder, tidied

FINGERPRINT_FILE = "recipe"  # file of the work folder: what is being made


@contextmanager
def resumable_folder(path: str | Path, fingerprint: str, force: bool = False) -> Iterator[Path]:
    """The folder to fill, `.NAME.building/whole` beside `path`; it is moved to `path` when the block succeeds.

    It holds the work of an earlier, unfinished run if that had the same `fingerprint`; other work is removed. Its
    parent may hold a record of the progress. If the block fails, the work is kept and the exception says that the same
    command resumes it: `InputError` for an OSError such as a full disk, `KeyboardInterrupt` for Ctrl-C. After an
    `InputError` of the block the work is removed, because the same input would fail again. Also raises `InputError`
    where `whole_folder` does, and while another process makes the same folder.
    """
    target = check_folder(tidied(path), force)
    work = beside(target, "building")
    with parents_of(target), alone(target):
        check_folder(target, force)  # another process may have made it before this one had the lock
        _make_room(work, fingerprint)
        resume_hint = f"what is done is kept in {work}, the same command resumes it"
        try:
            with holding(work):
                yield work / BUILT
            put_folder(work / BUILT, target)
            names_written.append(Path(path))
        except KeyboardInterrupt as interrupt:
            raise KeyboardInterrupt(resume_hint) from interrupt
        except InputError:
            remove_work(work)
            raise
        except OSError as error:
            advice = FULL.get(error.errno or 0) or error.strerror or str(error)
            raise InputError(f"{target}: {advice}; {resume_hint}") from error
        remove_work(work)
        remove_work(beside(target, "writing"))


def _make_room(work: Path, fingerprint: str) -> None:
    """Prepare the work folder: keep earlier work of the same `fingerprint`, remove any other."""
    recipe = work / FINGERPRINT_FILE
    check_work(work, FINGERPRINT_FILE)
    if recipe.is_file() and recipe.read_text(encoding="utf-8") != fingerprint:
        warnings.warn(f"{work} held unfinished work on another recipe, which was removed", stacklevel=4)
        remove_work(work)
    if not recipe.is_file() or holds_other(work):
        remove_work(work)
        begin_work(work)
        (work / BUILT).mkdir()
        number_built(work)
        partial = work / (FINGERPRINT_FILE + ".partial")
        partial.write_text(fingerprint, encoding="utf-8")
        sync_one(partial)
        os.replace(partial, recipe)  # last: work that has its recipe is complete
    (work / MARK).touch()
    (work / BUILT).mkdir(exist_ok=True)
    for partial in work.rglob("*.partial"):
        partial.unlink()
