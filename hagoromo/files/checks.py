"""Checks of paths and sizes before a file is opened: what kind of file it is, where it lies, and how large it is."""

from __future__ import annotations

import os
import re
import stat
import sys
from pathlib import Path, PureWindowsPath

from hagoromo.errors import InputError
from hagoromo.files.memory import require

KINDS = (
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)
DEFLATE = 1032.0  # bytes that one packed byte stands for, at most (zlib, "Technical Details")
PACKED = 2048.0  # the same, of the packings of pictures and volumes: LZW 1340, JPEG 512 pixels
ALLOWED = "HAGOROMO_ALLOW"  # environment: folders, between os.pathsep, whose files may be named from elsewhere
AT_ONCE = getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)  # a pipe without a writer would block for ever


DEVICES = re.compile(r"(con|prn|aux|nul|conin\$|conout\$|(com|lpt)[0-9¹²³])[ ]*([.:].*)?", re.IGNORECASE)


def check_name(path: str | Path) -> None:
    """Raise `InputError` on Windows for a name that it keeps for a device, or that it would change without a word.

    What is written to NUL or con.exr is lost there; a name loses the dots and spaces at its end.
    """
    if sys.platform != "win32":
        return
    named = PureWindowsPath(path)
    for part in named.parts[1 if named.anchor else 0 :]:
        if part not in (".", "..") and (DEVICES.fullmatch(part) or part[-1] in " ." or ":" in part):
            raise InputError(f"{path}: Windows keeps the name {part!r} for itself or changes it: choose another")


def check_text(path: str | Path) -> None:
    """Raise `InputError` for a path that is not in UTF-8: libraries that are given one raise, or end the process."""
    try:
        str(path).encode()
    except UnicodeEncodeError:
        raise InputError(f"{path}: a name in it is not in UTF-8: rename the file or the folder") from None


def existing_file(path: str | Path) -> Path:
    """`path` as a `Path`; `InputError` when it is not an existing file, or a pipe, a socket or a device.

    Every reader asks it before it opens a file: reading a pipe may wait for ever, and a device may have no end.
    """
    file = Path(path)
    check_text(path)
    try:
        mode = os.stat(file).st_mode
    except (FileNotFoundError, NotADirectoryError):
        raise InputError(f"{file} does not exist: check the path") from None
    except (OSError, ValueError) as error:  # a loop of links, a name that is too long or holds a zero
        raise InputError(f"{file} cannot be opened: {_reason(error)}: check the path") from error
    if stat.S_ISDIR(mode):
        raise InputError(f"{file} is a folder: give a file")
    if not stat.S_ISREG(mode):
        kind = next((name for is_kind, name in KINDS if is_kind(mode)), "no regular file")
        raise InputError(f"{file} is {kind}: give a file on a disk")
    return file


def existing_folder(path: str | Path) -> Path:
    """`path` as a `Path`; `InputError` when it is not an existing folder."""
    folder = Path(path)
    check_text(path)
    if not folder.exists():
        raise InputError(f"{folder} does not exist: check the path")
    if not folder.is_dir():
        raise InputError(f"{folder} is a file: give a folder")
    return folder


def of_folder(folder: str | Path, name: str, give: str) -> Path:
    """The file `name` of an existing folder that is known by it; `InputError` for a folder without it, or none.

    give: what to give in its place, as the message calls it.
    """
    file = inside(existing_folder(folder), name)
    if not file.exists():
        raise InputError(f"{folder} has no {name}: give {give}")
    return file


def sized_file(path: str | Path, most: int, what: str) -> Path:
    """`existing_file` of at most `most` bytes; what: the kind of file, with its article, as messages call it."""
    file = existing_file(path)
    size = file.stat().st_size
    if size > most:
        raise InputError(f"{file} has {size} bytes, {what} {most} at most: give another")
    return file


def check_density(stated: float, file: Path, most: float, what: str) -> None:
    """Raise `InputError` where a file states more than it can hold, whatever its header says.

    stated: bytes (or pixels) that it shall unpack to. most: of them for each of its bytes, as its packing can hold.
    what: stated in words.
    """
    size = file.stat().st_size
    if stated > most * size:
        raise InputError(f"{file} states {what} and has {size} bytes, too few for them: it is damaged, copy it again")


def read_bytes(path: str | Path, growth: float = 1.0) -> bytes:
    """All bytes of an existing file, which is looked at again once it is open.

    growth: memory that the bytes and what is made of them take, in sizes of the file; it must be free.
    """
    file = existing_file(path)
    descriptor = os.open(file, os.O_RDONLY | AT_ONCE)
    with open(descriptor, "rb") as opened:
        status = os.fstat(descriptor)
        if not stat.S_ISREG(status.st_mode):
            raise InputError(f"{file} has changed while it was opened: give a file on a disk")
        require(growth * status.st_size, str(file))
        return opened.read(status.st_size)


def inside(folder: str | Path, relative: str) -> Path:
    """The path `relative` in `folder`; `InputError` if it points outside `folder`, also by a link.

    A link within the folder to a place within it is followed; `folder` itself may be a link. Folders that the variable
    HAGOROMO_ALLOW of the environment lists (as the option --allow does) may be led to.
    """
    path = os.path.normpath(relative)
    if (outside := _allowed(folder, path)) is not None:
        return outside
    if os.path.isabs(path) or os.path.splitdrive(path)[0] or path == ".." or path.startswith(".." + os.sep):
        raise InputError(
            f"{relative!r} points outside {folder}: give a path inside it, or allow the folder where it lies (--allow)"
        )
    try:
        home = os.path.realpath(folder)
        place = os.path.realpath(os.path.join(home, path))
        is_within = os.path.commonpath([home, place]) == home
    except (OSError, ValueError) as error:
        raise InputError(f"{relative!r} is no path: {_reason(error)}: give a path inside {folder}") from error
    if not is_within:
        raise InputError(f"{relative!r} is a link that leads outside {folder}: put the file itself there")
    return Path(folder) / path


def _allowed(folder: str | Path, path: str) -> Path | None:
    """The place of `path` where it lies in a folder that the user allowed, links followed; None where it does not."""
    folders = [each for each in os.environ.get(ALLOWED, "").split(os.pathsep) if os.path.isabs(each)]
    if not folders:
        return None
    try:
        place = os.path.realpath(os.path.join(folder, path))
        homes = map(os.path.realpath, folders)
        return Path(folder) / path if any(os.path.commonpath([home, place]) == home for home in homes) else None
    except (OSError, ValueError):
        return None


def _reason(error: Exception) -> str:
    return getattr(error, "strerror", None) or str(error)
