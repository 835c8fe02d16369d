"""Outputs that appear complete or not at all; everything that this package writes is written through this module.

A file is written into a hidden work folder beside its target, checked, brought to the disk and moved to the target at
once. After a failure, Ctrl-C or a full disk the work is removed and the target is unchanged. What a killed process
leaves is dealt with by the next who writes the target, see `leftovers`. Links are followed; a link to nothing, and what
is neither a file nor a folder, is refused.
"""

from __future__ import annotations

import errno
import logging
import os
import secrets
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from hagoromo.errors import InputError
from hagoromo.files.checks import check_name, check_text
from hagoromo.files.exchange import exchange, move_new, sync, sync_one
from hagoromo.files.leftovers import (
    COMMIT,
    GROUP,
    MARK,
    OLD,
    alone,
    begin_work,
    beside,
    commit,
    finish,
    remove_work,
    tidy,
)

FULL = {
    errno.ENOSPC: "the disk is full: free some space",
    errno.EDQUOT: "the quota of the disk is used up: free some space",
    errno.EFBIG: "the file is larger than the system allows: raise the limit (ulimit -f)",
}
LOG = logging.getLogger(__name__)
SCRATCH = "hagoromo-scratch-"  # name of scratch folders, before their number
names_written: list[Path] = []  # targets that were written since it was last cleared
_held: set[Path] = set()  # work folders of this process: what is written into them is moved with them


@contextmanager
def whole_file(path: str | Path, force: bool = False) -> Iterator[Path]:
    """Temporary path, with the name of `path`, to write to; it is moved to `path` when the block succeeds.

    `InputError` if `path` exists without `force`, is no regular file or is being written by another process, and for
    a full disk.
    """
    with whole_files((path,), force) as (partial,):
        yield partial


@contextmanager
def whole_files(paths: Sequence[str | Path], force: bool = False) -> Iterator[list[Path]]:
    """Temporary paths of files that belong together, all in one folder; see `whole_file`.

    They are moved one after the other, the first of `paths` last. If the process is killed in between, the next who
    writes one of them completes the others first: so either all are new or, after that, none is old.
    """
    replaceable_files(paths, force)
    targets = [followed(path) for path in paths]
    main = targets[0]
    if len({target.parent for target in targets}) != 1 or len(set(targets)) != len(targets):
        named = " and ".join(map(str, paths))
        raise InputError(f"{named} must be different files of one folder, links followed: choose other names")
    if _is_held(main):
        main.parent.mkdir(parents=True, exist_ok=True)
        yield targets
        return
    with parents_of(main), _in_one_line(main), ExitStack() as stack:
        for target in targets:
            stack.enter_context(alone(target, targets))
        works = [beside(target, "writing") for target in targets]
        for target in targets:
            check_file(target, force)  # another process may have made it before this one had the lock
        try:
            begin_work(works[0])
            partials = [works[0] / target.name for target in targets]
            with holding(works[0]):
                yield partials
            for partial, target in zip(partials, targets, strict=True):
                check_written(partial, target)
            _put_files(works, targets, force)
            names_written.extend(map(Path, paths))
        finally:
            if not (works[0] / COMMIT).exists():
                for work in reversed(works):
                    remove_work(work)


@contextmanager
def whole_folder(path: str | Path, force: bool = False, announced: bool = True) -> Iterator[Path]:
    """Temporary empty folder to fill; it is moved to `path` when the block succeeds.

    announced: whether it is a result, which an interrupt says was written.
    `InputError` if `path` is a non-empty folder without `force`; with `force`, if Hagoromo did not write it (other
    files are never deleted); while another process writes it, and for a full disk. The old folder is exchanged for the
    new one at once, where the system can do that.
    """
    target = check_folder(tidied(path), force)
    if _is_held(target):
        target.mkdir(parents=True, exist_ok=True)
        yield target
        (target / MARK).touch()
        return
    with parents_of(target), _in_one_line(target), alone(target):
        check_folder(target, force)
        work = beside(target, "writing")
        try:
            partial = begin_work(work) / target.name
            partial.mkdir()
            with holding(work):
                yield partial
            check_folder(target, force)
            put_folder(partial, target)
            if announced:
                names_written.append(Path(path))
        finally:
            remove_work(work)


def write_bytes(path: str | Path, data: bytes) -> None:
    """Write a file, whole or not at all; what is there is replaced."""
    with whole_file(path, force=True) as partial, partial.open("wb") as file:
        file.write(data)


def write_text(path: str | Path, text: str) -> None:
    """Write a file of UTF-8 text with the ends of lines as they are, whole or not at all."""
    write_bytes(path, text.encode("utf-8"))


def replaceable_file(path: str | Path, force: bool = False) -> Path:
    """`path`, if a file may be written there; raises `InputError` as `whole_file` does."""
    replaceable_files((path,), force)
    return Path(path)


def replaceable_files(paths: Sequence[str | Path], force: bool = False) -> None:
    """Raise `InputError` as `whole_files` does, before the work that they are the result of."""
    for path in paths:
        tidied(path)  # of all, before one of them is refused
    for path in paths:
        check_file(path, force)


def replaceable_folder(path: str | Path, force: bool = False) -> Path:
    """`path`, if a folder may be written there; raises `InputError` as `whole_folder` does."""
    check_folder(tidied(path), force)
    return Path(path)


def put_folder(whole: Path, target: Path) -> None:
    """Mark the folder `whole` as Hagoromo's and move it to `target`; the lock of `target` is held.

    An old folder there is exchanged for it and then lies at `whole`, or in the work folder of `target`.
    """
    (whole / MARK).touch()
    sync(whole)
    if not target.exists():
        move_new(whole, target)
    elif not exchange(whole, target):
        old = begin_work(beside(target, "writing")) / OLD
        os.replace(target, old)
        try:
            os.replace(whole, target)
        except BaseException:
            os.replace(old, target)
            raise
    sync_one(target.parent)


def followed(path: str | Path) -> Path:
    """`path` with all links followed; `InputError` for a link to nothing, or for a name that Windows keeps
    or that is not in UTF-8.
    """
    check_name(path)
    given = Path(path)
    if given.is_symlink() and not given.exists():
        raise InputError(f"{given} is a link to what does not exist: remove the link, or give another name")
    target = Path(os.path.realpath(given))
    check_text(target)
    if not target.name:
        raise InputError(f"{given} is the root of a disk: give the name of a file or folder on it")
    return target


def check_written(partial: Path, path: str | Path, whole: bool = True) -> None:
    """Raise OSError unless something was written to `partial`: some libraries do not say that they failed.

    whole: what the writer found when it looked at the file.
    """
    if not whole or not partial.is_file() or partial.stat().st_size == 0:
        raise OSError(errno.EIO, "less was written than should be: the disk may be full", str(path))


def check_file(path: str | Path, force: bool) -> Path:
    """`path` with links followed; raises `InputError` as `whole_file` does, leftovers untouched."""
    target = followed(path)
    if target.is_dir():
        raise InputError(f"{path} is a folder: give a file name")
    if Path(path).exists() and not target.is_file():
        raise InputError(f"{path} is a device or a pipe: give the name of a file")
    if target.exists() and not force:
        raise InputError(f"{path} exists: choose another name or add force (--force)")
    return target


def check_folder(path: str | Path, force: bool) -> Path:
    """`path` with links followed; raises `InputError` as `whole_folder` does, leftovers untouched."""
    target = followed(path)
    if Path(path).exists() and not target.is_dir():
        raise InputError(f"{path} is a file: give a folder name")
    if Path.cwd().is_relative_to(target):
        raise InputError(f"{path} is the folder that this runs in, or holds it: give the name of another folder")
    if os.path.ismount(target):
        raise InputError(f"{path} is where a file system is mounted: give the name of a folder in it")
    if target.exists() and any(target.iterdir()):
        if not force:
            raise InputError(f"{path} exists: choose another name or add force (--force)")
        if not (target / MARK).exists():
            raise InputError(f"{path} holds files that Hagoromo did not write: choose another name")
    return target


def tidied(path: str | Path) -> str | Path:
    """`path`, once leftovers of killed processes are dealt with; `InputError` while another process writes it."""
    target = followed(path)
    if not _is_held(target):
        tidy(target)
    return path


def _put_files(works: list[Path], targets: list[Path], force: bool) -> None:
    """Move the files of the first of `works` to their targets."""
    main = targets[0]
    if len(targets) == 1:
        sync(works[0])
        (os.replace if force else move_new)(works[0] / main.name, main)
        sync_one(main.parent)
        LOG.debug("wrote %s", main)
        return
    for work in works[1:]:
        (begin_work(work) / GROUP).write_text(main.name, encoding="utf-8")
        sync(work)
    for target in targets:
        check_file(target, force)
    try:
        commit(works[0], [target.name for target in reversed(targets)])
    except BaseException:
        finish(works[0])
        raise
    LOG.debug("wrote %s", " and ".join(map(str, targets)))


def _is_held(target: Path) -> bool:
    """Whether `target` lies in a work folder of this process."""
    return not _held.isdisjoint(target.parents)


@contextmanager
def scratch_folder(within: Path | None = None) -> Iterator[Path]:
    """An empty folder in `within` (default: the system's for temporary files), removed when the block ends.

    Those that killed processes left there are removed first.
    """
    home = Path(os.path.realpath(within or tempfile.gettempdir()))
    for name in {left.name.split(".")[1] for left in home.glob(f".{SCRATCH}*.*")}:
        with suppress(InputError, OSError):  # another process uses it, or it is another user's
            tidy(home / name)
    target = home / (SCRATCH + secrets.token_hex(8))
    with alone(target):
        work = begin_work(beside(target, "writing"))
        try:
            (work / SCRATCH).mkdir()
            with holding(work):
                yield work / SCRATCH
        finally:
            remove_work(work)


@contextmanager
def holding(work: Path) -> Iterator[None]:
    """While the block runs, files in the folder `work` are written in place."""
    _held.add(work)
    try:
        yield
    finally:
        _held.discard(work)


@contextmanager
def parents_of(target: Path) -> Iterator[None]:
    """The folders above `target`, which are made, and removed again if the block fails and leaves them empty."""
    made = [parent for parent in target.parents if not parent.exists()]
    target.parent.mkdir(parents=True, exist_ok=True)
    try:
        yield
    except BaseException:
        with suppress(OSError):
            for parent in made:
                parent.rmdir()
        raise


@contextmanager
def _in_one_line(target: Path) -> Iterator[None]:
    """A full disk as one line; other errors of what lies beside the target name the target."""
    try:
        yield
    except OSError as error:
        named = Path(str(error.filename or target))
        if error.errno not in FULL:
            if named.parent == target.parent and named.name.startswith("."):
                raise OSError(error.errno, error.strerror, str(target)) from error
            raise
        where = target if named.is_relative_to(target.parent) else named
        raise InputError(f"{where}: {FULL[error.errno]}; {target} is as it was") from error
