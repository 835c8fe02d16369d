"""Zarr arrays of numbers on disk, which may come from untrusted sources.

Before any chunk is read, `InputError` is raised for a folder that contains a link, a codec that is not in CODECS
(decoding pickled objects would run code), a type that is not numeric, and a chunk that does not fit into the memory.
The message about a chunk that cannot be decoded names its file.
"""

from __future__ import annotations

import itertools
import math
import os
import re
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.checks import existing_folder
from hagoromo.files.memory import require
from hagoromo.files.names import reason
from hagoromo.files.reading import reading
from hagoromo.files.record import JSON_GROWTH, json_value
from hagoromo.files.stores import address, check_reached, object_size, read_whole, sizes, zarr_store

CODECS = (
    "bytes", "transpose", "sharding_indexed", "crc32c", "zstd", "gzip", "blosc",  # Zarr v3
    "zlib", "bz2", "lz4", "lzma", "shuffle", "delta", "fixedscaleoffset", "crc32",  # v2
)  # fmt: skip
METADATA = ("zarr.json", ".zarray", ".zattrs", ".zgroup")  # files that zarr-python reads as JSON
LARGEST_METADATA = 1 << 24  # bytes
BYTES_PER_INNER_CHUNK = 1000  # what zarr-python keeps of each chunk of a shard while it reads it
NUMBER_KINDS = "biuf"  # kinds of NumPy types
Index = tuple[int, ...]


@dataclass(frozen=True, eq=False)
class ZarrArray:
    """A checked array: `array` of zarr-python, and the file of each chunk that exists."""

    array: Any
    where: str
    files: Mapping[Index, str]

    @property
    def shape(self) -> Index:
        """Length of each axis."""
        return self.array.shape

    @cached_property
    def grid(self) -> Index:
        """Length of each axis of the part that one file holds."""
        return self.array.shards or self.array.chunks

    @property
    def absent_is_zero(self) -> bool:
        """Whether a chunk without a file means zeros."""
        return bool(self.array.fill_value == 0)

    def read(self, low: Index, high: Index) -> NDArray:
        """The numbers from index `low` to `high` (excluded); `InputError` if they cannot be decoded."""
        index = tuple(first // size for first, size in zip(low, self.grid, strict=True))
        ends = zip(index, self.grid, self.shape, strict=True)
        cell = tuple((k * size, min((k + 1) * size, n)) for k, size, n in ends)
        whole = cell == tuple(zip(low, high, strict=True))
        if whole and index not in self.files:
            return np.full([b - a for a, b in cell], self.array.fill_value, self.array.dtype)
        try:
            self._check_files(low, high)
            if whole and self._decode:
                stored = np.frombuffer(self._decode(read_whole(self.files[index])), self.array.dtype)
                return stored.reshape(self.grid)[tuple(slice(b - a) for a, b in cell)]
            return np.asarray(self.array[tuple(map(slice, low, high))])
        except Exception as error:  # codecs raise what comes to them at damaged bytes
            check_reached(self.where)
            place = self.files[index] if whole else f"{self.where} near {low}"
            raise InputError(f"{place} cannot be decoded, the file is damaged: {reason(error)}") from error

    @cached_property
    def _decode(self) -> Callable[[bytes], Any] | None:
        """Decoder of plain Zstandard chunks: zarr-python takes a millisecond more per chunk."""
        from hagoromo.files.zarr_codecs import unpacked

        codecs = _codecs(self.array.metadata)
        plain = [name for name, _ in codecs] == ["bytes", "zstd"] and self.array.shards is None
        native = codecs[0][1].get("endian", sys.byteorder) == sys.byteorder if plain else False
        size = math.prod(self.grid) * self.array.dtype.itemsize
        return (lambda data: unpacked("zstd", data, size, True, {})) if native else None

    @cached_property
    def _largest_file(self) -> float:
        """Most bytes that a file may have: those of its chunks, packed."""
        from hagoromo.files.zarr_codecs import packed_limit

        return packed_limit(math.prod(self.grid) * self.array.dtype.itemsize, inner_chunks(self.array))

    def _check_files(self, low: Index, high: Index) -> None:
        """ValueError for a file of the part from `low` to `high` that is larger than what it may hold."""
        spans = (range(a // n, -(-b // n)) for a, b, n in zip(low, high, self.grid, strict=True))
        for file in filter(None, map(self.files.get, itertools.product(*spans))):
            stored = object_size(file)
            if stored == 0:
                raise ValueError("it is empty")  # zarr-python takes an empty shard for one that is not there
            if stored > self._largest_file:
                raise ValueError(f"it is larger than the {self._largest_file:.0f} bytes that its chunks may take")


def open_arrays(path: str | Path, names: tuple[str, ...] = ()) -> tuple[dict[str, Any], dict[str, ZarrArray]]:
    """Attributes and arrays of the Zarr v3 group at `path`; `names` that do not exist are omitted."""
    import zarr

    folder, files = _opened(path)
    _check_metadata(folder, ("", *(f"{name}/" for name in names)), files)
    with _reading(folder):
        group = zarr.open_group(zarr_store(folder), mode="r", zarr_format=3, use_consolidated=False)
        members = {name: group[name] for name in names if f"{name}/zarr.json" in files}
        return group.attrs.asdict(), {
            name: _checked(array, folder / name, {f[len(name) + 1 :] for f in files if f.startswith(f"{name}/")})
            for name, array in members.items()
        }


def open_array(path: str | Path) -> ZarrArray:
    """The Zarr array, v2 or v3, at `path`."""
    import zarr

    folder, files = _opened(path)
    _check_metadata(folder, ("",), files)
    with _reading(folder):
        return _checked(zarr.open_array(zarr_store(folder), mode="r"), folder, files)


@contextmanager
def _reading(folder: Path) -> Iterator[None]:
    """As `reading`, but a store that is not reached is not called damaged."""
    try:
        with reading(folder, "Zarr"):
            yield
    except InputError:
        check_reached(folder)
        raise


def _opened(path: str | Path) -> tuple[Path, set[str]]:
    """The folder, or the address of a store, and the paths of all files under it."""
    if address(path) is not None:
        return Path(path), set(sizes(path))
    folder = existing_folder(path)
    return folder, _files(folder)


def _files(folder: Path) -> set[str]:
    """Paths of all files under `folder`, relative to it; `InputError` for links, pipes and other special files."""
    paths, pending = set(), [(str(folder), "")]
    while pending:
        directory, prefix = pending.pop()
        with os.scandir(directory) as entries:
            for entry in entries:
                if entry.is_dir(follow_symlinks=False):
                    pending.append((entry.path, f"{prefix}{entry.name}/"))
                elif entry.is_file(follow_symlinks=False):
                    paths.add(prefix + entry.name)
                else:
                    raise InputError(f"{entry.path} is a link or not a regular file: put the file itself there")
    return paths


def _check_metadata(folder: Path, places: tuple[str, ...], files: set[str]) -> None:
    """InputError for a description of an array or group that is too large, no table, or has true for a number."""
    for name in (place + name for place in places for name in METADATA):
        if name in files:
            where, size = str(folder / name), object_size(folder / name)
            if size > LARGEST_METADATA:
                raise InputError(f"{where} has {size} bytes, a description of arrays {LARGEST_METADATA} at most")
            require(JSON_GROWTH * size, where)
            record = json_value(read_whole(folder / name), where)
            if not isinstance(record, dict):
                raise InputError(f"{where} must hold a table of keys: given {type(record).__name__}")
            grid = record.get("chunk_grid")
            inner = grid.get("configuration") if isinstance(grid, dict) else None
            chunk = inner.get("chunk_shape") if isinstance(inner, dict) else None
            for key, sizes_of in (("shape", record.get("shape")), ("chunks", record.get("chunks")), ("chunk", chunk)):
                if isinstance(sizes_of, list) and not all(type(n) is int and n >= 0 for n in sizes_of):
                    raise InputError(f"{where}: {key} must be a list of whole numbers from 0: given {sizes_of!s:.60}")


def _checked(array: Any, folder: Path, files: set[str]) -> ZarrArray:
    """`array`, if it is numeric, uses known codecs only, and its chunks fit into the memory; it unpacks no more."""
    from hagoromo.files.zarr_codecs import bounded

    if not hasattr(array, "shape"):
        raise InputError(f"{folder} is a Zarr group: give the folder of an array")
    if array.dtype.kind not in NUMBER_KINDS:
        raise InputError(f"{folder} holds values of type {array.dtype}: give an array of numbers")
    for name, _ in _codecs(array.metadata):
        if name not in CODECS:
            raise InputError(f"{folder} is stored with the codec {name!r}: known are {', '.join(CODECS)}")
    chunk = array.dtype.itemsize * math.prod(array.shards or array.chunks)
    require(2.0 * chunk + BYTES_PER_INNER_CHUNK * inner_chunks(array), f"one chunk of {folder}")
    pipeline = array.async_array.codec_pipeline
    object.__setattr__(array.async_array, "codec_pipeline", bounded(pipeline, chunk))  # of this array only
    chunks, parent = {}, f"{address(folder) or folder}{'/' if address(folder) else os.sep}"
    for name in files:
        match = re.fullmatch(r"(?:c[/.])?(\d+(?:[/.]\d+)*)", name)
        index = tuple(map(int, re.split("[/.]", match[1]))) if match else ()
        if match and array.metadata.encode_chunk_key(index) == name:
            chunks[index] = f"{parent}{name}"  # text, not Path, because there may be very many
    return ZarrArray(array, str(folder), chunks)


def inner_chunks(array: Any) -> int:
    """How many chunks a file of the array holds: 1 where it has no shards."""
    shards = array.shards or array.chunks
    return math.prod(-(-whole // part) for whole, part in zip(shards, array.chunks, strict=True))


def _codecs(metadata: Any) -> list[tuple[str, Mapping[str, Any]]]:
    """Names and settings of all codecs of an array, including those inside shards."""
    if metadata.zarr_format == 2:
        codecs = (*(metadata.filters or ()), metadata.compressor)
        records = [codec.get_config() for codec in codecs if codec is not None]
        return [(record["id"], record) for record in records]
    pending, entries = [codec.to_dict() for codec in metadata.codecs], []
    while pending:
        record = pending.pop(0)
        settings = record.get("configuration", {})
        entries.append((record["name"].removeprefix("numcodecs."), settings))
        pending += [*settings.get("codecs", ()), *settings.get("index_codecs", ())]
    return entries
