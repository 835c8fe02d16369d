"""Seal: a digest by which what was made of Zarr arrays knows that these are still the same.

It covers the metadata of each array, and of each chunk file its place, size and last bytes. Chunks that end in the
checksum of their content (`SEALED`) are so covered whole, and no more than the tail of a file is read.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from hashlib import blake2b
from pathlib import Path

from hagoromo.errors import InputError
from hagoromo.files.stores import address, read_whole
from hagoromo.files.stores import ends as store_ends
from hagoromo.files.zarr_arrays import ZarrArray
from hagoromo.volume.store.zarr_blocks import THREADS

SEALED = {"name": "zstd", "configuration": {"level": 0, "checksum": True}}  # the codec of arrays that are sealed
TAIL = 4  # bytes of the checksum
LARGEST_METADATA = 1 << 24  # bytes of a zarr.json in a store
FILES_AT_ONCE = 64  # files that a thread reads at a time


def seal(arrays: Iterable[ZarrArray]) -> str:
    """The seal of the arrays, in hexadecimal digits.

    Noticed: any change by a program that writes chunks with the codec of the array, and a chunk lost, added, cut or
    grown. Not noticed: bytes changed inside a chunk file whose length and end stay as they were.
    """
    digest = blake2b(digest_size=16)
    with ThreadPoolExecutor(THREADS) as threads:
        for array in sorted(arrays, key=lambda array: array.where):
            folder = Path(array.where)
            files = [file for _, file in sorted(array.files.items())]
            batches = [files[k : k + FILES_AT_ONCE] for k in range(0, len(files), FILES_AT_ONCE)]
            try:
                digest.update(
                    folder.name.encode() + blake2b(read_whole(folder / "zarr.json", LARGEST_METADATA)).digest()
                )
                digest.update(repr(sorted(array.files)).encode())
                for ends in threads.map(_ends, batches):
                    digest.update(ends)
            except OSError as error:
                raise InputError(f"{folder} cannot be read: {error}") from error
    return digest.hexdigest()


def _ends(paths: Sequence[str]) -> bytes:
    """Sizes and last bytes of files."""
    if paths and address(paths[0]):
        return b"".join(size.to_bytes(8) + tail for size, tail in store_ends(paths, TAIL))
    ends = []
    for path in paths:
        with open(path, "rb", buffering=0) as file:
            size = file.seek(0, os.SEEK_END)
            file.seek(max(size - TAIL, 0))
            ends.append(size.to_bytes(8) + file.read(TAIL))
    return b"".join(ends)
