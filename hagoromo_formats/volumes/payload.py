"""Payload: the numbers behind a header, plain or packed by gzip, zlib or bzip2; never more than the header states."""

from __future__ import annotations

import bz2
import math
import os
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.checks import DEFLATE, check_density, existing_file
from hagoromo.files.volume_file import Later, check_lattice, check_size

PIECE = 1 << 20  # bytes that are read at a time
PLAIN, ZLIB, GZIP, BZIP2 = "plain", "zlib", "gzip", "bzip2"
EXPANSIONS = {PLAIN: 1.0, ZLIB: DEFLATE, GZIP: DEFLATE, BZIP2: float(1 << 14)}  # bytes for a byte of the file, at most
WINDOW_BITS = {ZLIB: 15, GZIP: 31}


def read_payload(
    path: Path, start: int, shape: Sequence[int], kind: Any, packing: str = PLAIN, where: str = ""
) -> Later:
    """The array (in C order) of `shape` and type `kind` from byte `start` of the file on; where: what messages call it.

    start: −1 takes the last bytes of a file that is not packed. `InputError` where the file holds fewer numbers, or
    cannot hold as many; when they are read, also where they do not fit the memory.
    """
    where, kind = where or str(path), np.dtype(kind)
    check_lattice(shape, where)
    size = math.prod(map(int, shape)) * kind.itemsize
    held = existing_file(path).stat().st_size
    start = held - size if start < 0 else start
    if packing == PLAIN and (start < 0 or held < start + size):
        raise InputError(f"{path} has {held} bytes and its header states {start + size}: it is cut off, copy it again")
    check_density(size, path, EXPANSIONS[packing], f"{size} bytes of numbers")

    def read() -> NDArray[Any]:
        check_size(shape, kind.itemsize, where)
        if packing == PLAIN:
            return np.fromfile(path, kind, math.prod(shape), offset=start).reshape(shape)
        values = np.empty(size, np.uint8)
        with path.open("rb") as file:
            file.seek(start, os.SEEK_SET)
            _unpack(file, values, packing, where)
        return values.view(kind).reshape(shape)

    return Later(tuple(map(int, shape)), kind, read)


def _unpack(file: Any, values: NDArray[np.uint8], packing: str, where: str) -> None:
    """Fill `values` with what the rest of a file unpacks to."""
    unpacker: Any = bz2.BZ2Decompressor() if packing == BZIP2 else zlib.decompressobj(WINDOW_BITS[packing])
    filled, waiting = 0, b""
    try:
        while filled < values.size and not unpacker.eof:
            asked = packing == BZIP2 and not unpacker.needs_input
            waiting = waiting or (b"" if asked else file.read(PIECE))
            if not waiting and not asked:
                break
            piece = unpacker.decompress(waiting, min(PIECE, values.size - filled))
            waiting = b"" if packing == BZIP2 else unpacker.unconsumed_tail
            values[filled : filled + len(piece)] = np.frombuffer(piece, np.uint8)
            filled += len(piece)
    except (OSError, zlib.error, ValueError) as error:
        raise InputError(f"{where} cannot be unpacked, it is damaged: {error}: copy it again") from error
    if filled < values.size:
        raise InputError(f"{where} unpacks to {filled} bytes and its header states {values.size}: copy it again")
