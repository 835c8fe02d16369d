"""Stores: boxes, captures and results under an address such as s3://bucket/name, by fsspec; paths are files on disk.

An address that was taken for a path ("s3:/bucket/name") is known again. What a store holds may come from anyone: sizes
are asked for before anything is fetched. Of a folder in a store the file by which it is known (INDEX) is put last and
removed first, so that a reader finds the whole folder or none; what a killed upload left has none, and is replaced.
"""

from __future__ import annotations

import os
import re
import shutil
from collections import Counter, OrderedDict
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path, PurePosixPath
from threading import Lock
from typing import Any

from hagoromo.errors import InputError
from hagoromo.files.checks import existing_file
from hagoromo.files.memory import free_memory, require
from hagoromo.files.names import reason
from hagoromo.files.whole import MARK

SCHEMES = ("s3", "s3a", "gs", "gcs", "az", "abfs", "abfss", "memory")
ADDRESS = re.compile(r"(" + "|".join(SCHEMES) + r"):/+(.+)", re.DOTALL)
PASSWORD = re.compile(r"[^/@:]*:[^/]*@")  # at the start of an address; ABFS has container@account, without one
INDEX = ("report.html", "zarr.json", "transforms.json", "materials.json")
KEPT_MB = "HAGOROMO_KEPT_MB"  # environment: megabytes of what was fetched that a worker keeps
MOST_KEPT = 10**9  # bytes, where it states none
MOST_OBJECTS = 10_000_000
SHARE_OF_DISK = 0.9  # of what is free, for what is fetched
traffic: Counter[str] = Counter()  # "objects" and "bytes" that this process has read from stores, without their lists


def address(path: str | Path) -> str | None:
    """The address of a store that `path` is; None for the path of a file or folder on disk.

    `InputError`, which does not repeat it, for an address that holds a password.
    """
    match = ADDRESS.fullmatch(str(path))
    if match and PASSWORD.match(match[2]):
        raise InputError(
            f"an address {match[1]}:// holds a password, which would be seen: give it by the variables of the store"
        )
    return f"{match[1]}://{match[2]}" if match else None


def is_file(path: str | Path) -> bool:
    """Whether a file, or an object of a store, is there."""
    if address(path) is None:
        return Path(path).is_file()
    with _opened(path) as (files, key):
        try:
            return files.info(key)["type"] == "file"  # not isfile, which takes a store that is not reached for no file
        except FileNotFoundError:
            return False


def check_reached(path: str | Path) -> None:
    """`InputError` where `path` is in a store that cannot be reached: asked before what is in it is called damaged."""
    if address(path) is None:
        return
    with _opened(path) as (files, key), suppress(FileNotFoundError):
        files.invalidate_cache()
        files.info(key)


def object_size(path: str | Path) -> int:
    """Bytes of a file or object; of objects of a folder that was listed, no request is made."""
    if address(path) is None:
        return Path(path).stat().st_size
    with _opened(path) as (files, key):
        return int(files.info(key)["size"])


def read_whole(path: str | Path, most: float | None = None) -> bytes:
    """All bytes of a file or object; of `most` bytes at most, if that is given."""
    size = object_size(path)
    if most is not None and size > most:
        raise InputError(f"{address(path) or path} has {size} bytes, {most:.0f} at most: it is damaged")
    if address(path) is None:
        return Path(path).read_bytes()
    with _opened(path) as (files, key):
        tag = str(files.info(key).get("ETag", ""))  # of the list that was made before, as the size
        data = kept.get(str(address(path)), tag)
        if data is None:
            require(float(size), str(address(path)))
            data = files.cat_file(key, start=0, end=size) if size else b""  # an empty object has no first byte
            traffic.update(objects=1, bytes=len(data))
            kept.put(str(address(path)), tag, data)
    return data


class Kept:
    """Objects that were fetched, those used last up to `most` bytes, each until the store has another in its place."""

    def __init__(self) -> None:
        self.most, self.bytes = 0, 0
        self._objects: OrderedDict[str, tuple[str, bytes]] = OrderedDict()
        self._lock = Lock()

    def get(self, url: str, tag: str) -> bytes | None:
        """The object, if it is kept and has that tag of its content."""
        with self._lock:
            known, data = self._objects.get(url, ("", b""))
            if not tag or known != tag:
                return None
            self._objects.move_to_end(url)
            return data

    def put(self, url: str, tag: str, data: bytes) -> None:
        """Keep an object, in place of those that were not used for longest; without a tag nothing is kept."""
        with self._lock:
            self.bytes -= len(self._objects.pop(url, ("", b""))[1])
            if tag and len(data) <= self.most:
                self._objects[url] = tag, data
                self.bytes += len(data)
            while self.bytes > self.most:
                self.bytes -= len(self._objects.popitem(last=False)[1][1])

    def forget(self) -> None:
        """Keep nothing, and nothing more from now on."""
        with self._lock:
            self._objects.clear()
            self.most = self.bytes = 0


kept = Kept()


def keep_fetched() -> None:
    """From now on keep what is fetched, for the next scene: HAGOROMO_KEPT_MB megabytes of it.

    By default a tenth of the memory that is free, 1 GB at most.
    """
    if kept.most == 0:
        stated = os.environ.get(KEPT_MB, "")
        if stated and not (stated.isascii() and stated.isdigit() and len(stated) < 8):
            raise InputError(f"{KEPT_MB} is {stated!r:.60}: give a whole number of megabytes, 0 for none")
        kept.most = 10**6 * int(stated) if stated else min(free_memory() // 10, MOST_KEPT)


def forget_fetched() -> None:
    """Give back what `keep_fetched` kept, and keep nothing more."""
    kept.forget()


def sizes(path: str | Path) -> dict[str, int]:
    """Bytes of each object under an address, by its name below it."""
    return {name: facts["size"] for name, facts in _listed(path).items()}


def state(path: str | Path) -> str:
    """A text that changes when the objects under an address change: names, sizes, tags or times of change."""
    listed = _listed(path)
    kept = ("size", "ETag", "etag", "md5Hash", "generation", "mtime", "created", "LastModified")
    return repr([(name, [(key, str(facts[key])) for key in kept if key in facts]) for name, facts in listed.items()])


def ends(paths: Sequence[str], length: int) -> list[tuple[int, bytes]]:
    """Size and last bytes of objects of one store."""
    if not paths:
        return []
    with _opened(paths[0]) as (files, _):
        keys = [_key(path) for path in paths]
        found = [files.info(key)["size"] for key in keys]  # of the list that was made before, where the store keeps it
        data = files.cat_ranges(keys, [max(size - length, 0) for size in found], found)
    traffic.update(objects=len(keys), bytes=sum(map(len, data)))
    return list(zip(found, data, strict=True))


def zarr_store(path: str | Path) -> Any:
    """What zarr-python opens to read: the folder itself, or its store."""
    url = address(path)
    if url is None:
        return path
    from zarr.storage import FsspecStore

    with _opened(path):
        return FsspecStore.from_url(url, read_only=True)


def fetch(path: str | Path, folder: Path) -> Path:
    """A copy on disk, in `folder`, of the file or folder under an address; its size is asked for first."""
    listed, name = sizes(path), PurePosixPath(_key(path)).name
    if not listed:
        raise InputError(f"{address(path)} does not exist: check the address")
    free = shutil.disk_usage(folder).free
    if sum(listed.values()) > SHARE_OF_DISK * free:
        raise InputError(
            f"{address(path)} has {sum(listed.values()) / 2**30:.3g} GiB and {free / 2**30:.3g} GiB are free in "
            f"{folder}: set TMPDIR to a larger disk"
        )
    for inner in listed:
        target = folder / name / inner if inner else folder / name
        if ".." in PurePosixPath(inner).parts or "\\" in inner:
            raise InputError(f"{address(path)} has an object called {inner!r:.60}, which is no name of a file")
        target.parent.mkdir(parents=True, exist_ok=True)
        with _opened(path) as (files, key):
            files.get_file(f"{key}/{inner}" if inner else key, str(target))
    traffic.update(objects=len(listed), bytes=sum(listed.values()))
    return folder / name


def check_free(path: str | Path, force: bool) -> None:
    """`InputError` where something is under an address without `force`, or, with it, what Hagoromo did not write."""
    there = sizes(path)
    if MARK in there and not set(INDEX) & set(there):
        return  # what a killed upload left
    if there and not force:
        raise InputError(f"{address(path)} exists: choose another name or add force (--force)")
    if there and "" not in there and MARK not in there:
        raise InputError(f"{address(path)} holds files that Hagoromo did not write: choose another name")


def put(source: Path, path: str | Path) -> None:
    """Put a file or folder under an address, in place of what is there.

    A store puts each object whole or not at all. Of a folder, its index is removed first and put last.
    """
    with _opened(path) as (files, key):
        if source.is_file():
            files.put_file(str(existing_file(source)), key)
            return
        old = sizes(path)
        for name in sorted(old, key=_rank, reverse=True):  # its index first
            files.rm_file(f"{key}/{name}")
        names = [file.relative_to(source).as_posix() for file in source.rglob("*") if file.is_file()]
        for name in sorted(names, key=_rank):
            files.put_file(str(source / name), f"{key}/{name}")


def _rank(name: str) -> tuple[int, str]:
    """Order in which the objects of a folder are put: the mark that it is Hagoromo's first, the index last."""
    return -2 if name == MARK else INDEX.index(name) if name in INDEX else -1, name


def _listed(path: str | Path) -> dict[str, dict[str, Any]]:
    with _opened(path) as (files, key):
        files.invalidate_cache()
        found = {name: facts for name, facts in files.find(key, detail=True).items() if facts["type"] == "file"}
    if len(found) > MOST_OBJECTS:
        raise InputError(f"{address(path)} holds {len(found)} objects, {MOST_OBJECTS} at most: give a smaller folder")
    require(500.0 * len(found), f"a list of {address(path)}")
    root = key.strip("/")
    return {name.strip("/").removeprefix(root).lstrip("/"): found[name] for name in sorted(found)}


@contextmanager
def _opened(path: str | Path) -> Iterator[tuple[Any, str]]:
    """The file system of an address and the key in it; its errors as one line."""
    url = address(path) or str(path)
    try:
        yield _files(url.partition("://")[0]), _key(path)
    except InputError:
        raise
    except ImportError as error:
        raise InputError(f"{url}: {error}; install hagoromo[cluster], which reads s3://") from error
    except FileNotFoundError as error:
        raise InputError(f"{url} does not exist: check the address") from error
    except Exception as error:  # every store has exceptions of its own
        raise InputError(
            f"{url} cannot be reached: {reason(error)}: check the address and your access to it"
        ) from error


def _key(path: str | Path) -> str:
    return (address(path) or str(path)).partition("://")[2]


@cache
def _files(scheme: str) -> Any:
    """The file system of a scheme, with the settings of fsspec's configuration (FSSPEC_S3_…, AWS_ENDPOINT_URL)."""
    import fsspec

    return fsspec.filesystem(scheme)
