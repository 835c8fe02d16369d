"""Cache: results that took long, kept on this machine under a digest of all that they depend on.

An entry is a folder, named by the digest: content.json with the digest of its bytes, and `data` with what was made.
It counts only if it is the user's own, whole, and holds the bytes that were written; all else is made again. A cache
that cannot be had, written or read costs time and never a result.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeVar

from hagoromo import backend
from hagoromo.errors import InputError
from hagoromo.files.content import content
from hagoromo.files.leftovers import MARK, alone, beside, tidy
from hagoromo.files.record import read_json, write_json
from hagoromo.files.whole import whole_folder
from hagoromo.version import __version__

PLACE = "HAGOROMO_CACHE"  # environment: the folder of the cache, or "off"
BOUND_MB = "HAGOROMO_CACHE_MB"  # environment: most megabytes of it
DEFAULT_MB = 4000.0
SHARE_OF_DISK = 0.25  # of what is free on the disk, and of the cache itself, that the cache may have
DATA, NOTE = "data", "content.json"
NAME = re.compile(r"[0-9a-f]{64}")
LONGEST_NOTE = 4096  # bytes
WAIT_S, POLL_S = 5.0, 0.05  # for another process, then whether there are locks is asked again
PACKAGES = ("drjit", "mitsuba", "numpy", "scipy")  # whose versions may change the bits of a result
SOURCES = (
    "hagoromo",
    "hagoromo_campaigns",
    "hagoromo_formats",
    "hagoromo_matter",
    "hagoromo_page",
    "hagoromo_recovery",
)

Value = TypeVar("Value")


@dataclass(frozen=True)
class Cache:
    """folder: where it is. bound: most bytes of it. why_not: why it is not used; empty where it is."""

    folder: Path
    bound: float
    why_not: str = ""

    def kept(
        self,
        depends_on: Any,
        read: Callable[[Path], Value],
        make: Callable[[], Value],
        write: Callable[[Value, Path], object],
        once: bool = False,
    ) -> Value:
        """What `read` finds in an entry; where there is none, what `make` gives, which `write` writes for next time.

        depends_on: plain data that say all that the value depends on, beside the program itself. read, write: from and
        into a folder. once: whether one process makes it while others that ask for it wait, and read what it wrote; the
        next of them makes it where that process ends without.
        """
        if self.why_not:
            return make()
        entry = self.folder / key_of(depends_on)
        found = self._read(entry, read)
        if found:
            return found[0]
        with _one_at_a_time(entry) if once else nullcontext():
            found = self._read(entry, read) if once else None
            return found[0] if found else self._made(entry, make, write)

    def _made(self, entry: Path, make: Callable[[], Value], write: Callable[[Value, Path], object]) -> Value:
        """What `make` gives, written to an entry where that is possible."""
        value = make()
        with suppress(InputError, OSError):  # another process writes it, or the disk is full
            self._write(entry, value, write)
            self._trim(entry)
        return value

    @property
    def used(self) -> bool:
        """Whether results are kept at all."""
        return not self.why_not

    def has(self, depends_on: Any) -> bool:
        """Whether there is an entry; `kept` may still find that it is not whole."""
        return self.used and os.path.lexists(self.folder / key_of(depends_on))

    def entries(self) -> Iterator[tuple[Path, int, float]]:
        """Its entries, the size of each [bytes], and when it was last used [s]."""
        try:
            places = sorted(self.folder.iterdir())
        except OSError:
            return
        for place in places:
            if NAME.fullmatch(place.name) and not place.is_symlink() and (place / MARK).is_file():
                with suppress(OSError):
                    files = [file for file in place.rglob("*") if file.is_file()]
                    yield place, sum(file.lstat().st_size for file in files), _used(place)

    def clear(self) -> tuple[int, int]:
        """Remove all entries; how many, and how many bytes."""
        self._tidy()
        removed = [(place, size) for place, size, _ in self.entries() if _remove(place)]
        return len(removed), sum(size for _, size in removed)

    def _read(self, entry: Path, read: Callable[[Path], Value]) -> tuple[Value] | None:
        """The value in an entry; None without one, and where the entry is not as it was written: that is removed."""
        try:
            if not os.path.lexists(entry):
                return None
            if _noted(entry) == content(entry / DATA):
                value = read(entry / DATA)
                with suppress(OSError):
                    os.utime(entry / NOTE)
                return (value,)
        except (InputError, OSError):
            pass
        _remove(entry)
        return None

    def _write(self, entry: Path, value: Any, write: Callable[[Any, Path], object]) -> None:
        with whole_folder(entry, force=True, announced=False) as home:
            (home / DATA).mkdir()
            write(value, home / DATA)
            write_json(home / NOTE, {"content": content(home / DATA)})

    def _trim(self, newest: Path) -> None:
        """Remove the entries that were not used for longest, until the rest fits."""
        self._tidy()
        held = sorted(self.entries(), key=lambda one: (one[0] != newest, one[2]))
        held = [*held[1:], *held[:1]]  # the newest goes last
        total = sum(size for _, size, _ in held)
        most = min(self.bound, self._room())
        for place, size, _ in held:
            if total <= most:
                return
            if _remove(place):
                total -= size

    def _tidy(self) -> None:
        """Remove what killed processes left half written, and the locks of those that were making something."""
        import filelock

        for left in self.folder.glob(".*.writing"):
            with suppress(InputError, OSError):  # it is being written now
                tidy(left.with_name(left.name[1:].removesuffix(".writing")))

        for left in self.folder.glob(".*.making"):
            with suppress(filelock.Timeout, OSError), filelock.FileLock(left, timeout=0, thread_local=False):
                left.unlink(missing_ok=True)

    def _room(self) -> float:
        """Bytes that the disk can spare for all of the cache."""
        with suppress(OSError):
            return SHARE_OF_DISK * (shutil.disk_usage(self.folder).free + sum(size for _, size, _ in self.entries()))
        return 0.0


def cache() -> Cache:
    """The cache of this user, as the environment says; `InputError` for a bound that is no number."""
    stated = os.environ.get(BOUND_MB, "")
    try:
        bound = 1e6 * float(stated or DEFAULT_MB)
    except ValueError:
        bound = -1.0
    if not 0.0 <= bound < 1e18:
        raise InputError(f"{BOUND_MB} is {stated[:40]!r}: set it to a number of megabytes, or unset it")
    place = os.environ.get(PLACE, "")
    if place == "off":
        return Cache(Path(), bound, f"{PLACE} is off")
    try:
        folder = Path(os.path.abspath(place)) if place else _users_place()
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        return Cache(folder, bound, _why_not(folder))
    except (OSError, RuntimeError, ValueError) as error:
        return Cache(Path(place), bound, f"no folder for it can be made ({error})")


def key_of(depends_on: Any) -> str:
    """Digest of plain data and of the program that computes with them."""
    text = json.dumps([program(), depends_on], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


@lru_cache(maxsize=1)
def program() -> str:
    """Digest of the files of this package, of the versions of those it computes with, and of backend and machine."""
    import platform

    root = Path(__file__).resolve().parents[2]
    state = hashlib.sha256()
    for package in SOURCES:
        for file in sorted((root / package).rglob("*")):
            if not file.is_file() or file.suffix == ".pyc":
                continue
            state.update(f"{file.relative_to(root).as_posix()}\0".encode())
            state.update(hashlib.sha256(file.read_bytes()).digest())
    known = [__version__, backend.name(), platform.machine(), platform.system()]
    state.update("\0".join([*known, *(version(package) for package in PACKAGES)]).encode())
    return state.hexdigest()


@contextmanager
def _one_at_a_time(entry: Path) -> Iterator[None]:
    """Wait until no other process makes an entry; the system frees the lock of one that is killed.

    On a file system without locks nobody waits.
    """
    import filelock

    path = beside(entry, "making")
    lock = filelock.FileLock(path, timeout=WAIT_S, thread_local=False)
    held = False
    with suppress(OSError, NotImplementedError):
        while not held and not isinstance(lock, filelock.SoftFileLock):
            with suppress(filelock.Timeout):
                lock.acquire(poll_interval=POLL_S)
                held = True
    try:
        yield
    finally:
        if held:
            with suppress(OSError):
                if os.name != "nt":
                    path.unlink(missing_ok=True)  # while it is held: who waits for it notices that it is gone
            lock.release()


def _users_place() -> Path:
    from platformdirs import user_cache_path

    return user_cache_path("hagoromo", appauthor=False) / "kept"


def _why_not(folder: Path) -> str:
    """Why a folder is not to be trusted, or not to be used; where others cannot write, entries are the user's own."""
    facts = folder.stat()
    if sys.platform != "win32" and (facts.st_uid != os.geteuid() or facts.st_mode & 0o022):  # pyrefly: ignore[missing-attribute]
        return f"{folder} is another user's, or others may write to it"
    if not os.access(folder, os.R_OK | os.W_OK | os.X_OK):
        return f"{folder} cannot be written to"
    return ""


def _noted(entry: Path) -> str:
    """The digest that an entry should have; "" where it is no folder of this package, or leads out of itself."""
    if entry.is_symlink() or not (entry / MARK).is_file() or any(file.is_symlink() for file in entry.rglob("*")):
        return ""
    if (entry / NOTE).stat().st_size > LONGEST_NOTE:
        return ""
    note = read_json(entry / NOTE)
    return str(note.get("content", "")) if isinstance(note, dict) else ""


def _used(place: Path) -> float:
    """When an entry was last used [s]; long ago if it is not whole. A time to come, from a wrong clock, is now."""
    try:
        return min((place / NOTE).stat().st_mtime, time.time())
    except OSError:
        return 0.0


def _remove(entry: Path) -> bool:
    """Remove an entry, first what says that it is whole; False while another process writes it, or it cannot be."""
    try:
        if entry.is_symlink() or not entry.is_dir():
            entry.unlink()
            return True
        with alone(entry):
            (entry / NOTE).unlink(missing_ok=True)
            shutil.rmtree(entry)
        return True
    except (InputError, OSError):
        return False
