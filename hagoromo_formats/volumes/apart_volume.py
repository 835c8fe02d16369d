"""Volumes whose header, and numbers where they are packed, a library reads in a process apart.

Numbers that lie in the file as they are, one after the other, are mapped from it by us: no library sees them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.apart import Arrays, read_apart
from hagoromo.files.volume_file import Later, VolumeFile

ELSEWHERE = -1  # offset of numbers that are packed, or do not lie one after the other


def header_arrays(shape: Any, kind: Any, matrix: Any = None, offset: int = ELSEWHERE) -> Arrays:
    """What a header states, for `volume_apart`: (nz, ny, nx[, components]), type, matrix, where the numbers begin."""
    stated = {"shape": np.array(shape, np.int64), "kind": np.array(np.dtype(kind).str), "offset": np.array(offset)}
    return stated if matrix is None else stated | {"matrix": np.asarray(matrix, np.float64)}


def volume_apart(
    file: Path,
    what: str,
    header: Callable[..., Mapping[str, NDArray[Any]]],
    numbers: Callable[..., Mapping[str, NDArray[Any]]],
    wanted: str = "",
) -> VolumeFile:
    """The volume in a file. header gives `header_arrays` of it and of `wanted`, numbers gives `values`, both apart."""
    stated = read_apart(header, file, what, wanted)
    shape, kind = tuple(map(int, stated["shape"])), np.dtype(str(stated["kind"]))
    offset, where = int(stated["offset"]), f"{file}:{wanted}" if wanted else str(file)
    size = float(np.prod(shape, dtype=float)) * kind.itemsize

    def read() -> NDArray[Any]:
        if offset == ELSEWHERE:
            return read_apart(numbers, file, what, wanted, stated=size)["values"]
        if offset < 0 or file.stat().st_size < offset + size:
            raise InputError(f"{file} has fewer bytes than its header states: it is cut off, copy it again")
        return np.memmap(file, kind, "r", offset, shape)

    return VolumeFile(Later(shape, kind, read), stated.get("matrix"), where)


def whole_apart(file: Path, what: str, read: Callable[..., Mapping[str, NDArray[Any]]], wanted: str = "") -> VolumeFile:
    """The volume in a file that has no header: `read` gives `as_arrays` of it, apart."""
    arrays = read_apart(read, file, what, wanted)
    return VolumeFile(arrays["values"], arrays.get("matrix"), f"{file}:{wanted}" if wanted else str(file))


def as_arrays(volume: VolumeFile) -> Arrays:
    """values and matrix, of the process apart."""
    arrays = {"values": volume.values}
    return arrays if volume.matrix is None else arrays | {"matrix": volume.matrix}
