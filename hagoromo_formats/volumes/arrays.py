"""Volumes as plain arrays: NumPy's .npy, a dataset of HDF5, and .raw files whose name states their lattice.

None states a length. Axes are (z, y, x), the last one fastest, as in all of them.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from hagoromo.errors import InputError
from hagoromo.files.apart import Arrays
from hagoromo.files.checks import PACKED, check_density, existing_file
from hagoromo.files.format import file_and_part
from hagoromo.files.memory import require
from hagoromo.files.reading import library, reading
from hagoromo.files.volume_file import NUMBER_KINDS, VolumeFile
from hagoromo_formats.volumes.apart_volume import ELSEWHERE, header_arrays, volume_apart
from hagoromo_formats.volumes.payload import read_payload

LATTICE = re.compile(r"_(\d{1,6})x(\d{1,6})x(\d{1,6})_(u?int8|u?int16|u?int32|float32|float64)$")
MOST_DATASETS = 10_000


def read_npy(path: str | Path) -> VolumeFile:
    """The array of a .npy file, which is not copied into memory; never what was pickled."""
    with reading(path, "NumPy's .npy"):
        values = np.load(existing_file(path), mmap_mode="r", allow_pickle=False)
        if not isinstance(values, np.ndarray):
            raise InputError(f"{path} holds several arrays (.npz): give one .npy")
        return VolumeFile(values, None, str(path))


def read_raw_volume(path: str | Path) -> VolumeFile:
    """The volume of a file whose name ends in its lattice and type, such as head_256x256x113_uint8.raw (x fastest)."""
    path = Path(path)
    named = LATTICE.search(path.stem)
    if named is None:
        raise InputError(
            f"{path} has no header: name it like head_256x256x113_uint8.raw, or write a header .mhd or .nhdr beside it"
        )
    shape = [int(n) for n in named.groups()[2::-1]]
    kind = np.dtype(named[4]).newbyteorder("<")
    return VolumeFile(read_payload(path, 0, shape, kind, where=str(path)), None, str(path))


def read_hdf5(path: str | Path) -> VolumeFile:
    """The only dataset of three axes in an HDF5 file, or the one named behind a colon: scan.h5:entry/density."""
    library("h5py")
    file, name = file_and_part(path)
    return volume_apart(existing_file(file), "HDF5", header_by_h5py, numbers_by_h5py, name)


def header_by_h5py(path: Path, wanted: str) -> Arrays:
    """What an HDF5 file states of a dataset; run by `read_apart`."""
    with _dataset(path, wanted) as (file, data):
        check_density(math.prod(map(float, data.shape)) * data.dtype.itemsize, path, PACKED, f"a lattice {data.shape}")
        offset = data.id.get_offset()  # of what lies in one piece
        as_stored = data.dtype.kind in "iuf" and h5py_type(data.dtype) == data.id.get_type()
        plain = as_stored and file.userblock_size == 0
        return header_arrays(data.shape, data.dtype, None, offset if offset is not None and plain else ELSEWHERE)


def numbers_by_h5py(path: Path, wanted: str) -> Arrays:
    """The numbers of a dataset; run by `read_apart`."""
    with _dataset(path, wanted) as (_, data):
        chunk = math.prod(data.chunks or ()) * data.dtype.itemsize
        require(4.0 * math.prod(map(float, data.shape)) * data.dtype.itemsize + chunk, str(path))
        return {"values": data[()]}


@contextmanager
def _dataset(path: Path, wanted: str) -> Iterator[tuple[Any, Any]]:
    """The file and its dataset `wanted`; links to other files are not followed."""
    import h5py

    with reading(path, "HDF5"), h5py.File(path, "r", locking=False) as file:
        found = {key: each for key, each in _datasets(file) if not wanted or key == wanted}
        if len(found) != 1:
            names = ", ".join(key for key, _ in _datasets(file)) or "none"
            raise InputError(f"{path} has the volumes {names:.300}: name one, as in FILE.h5:NAME")
        (data,) = found.values()
        if data.external or data.is_virtual:
            raise InputError(f"{path} has its numbers in other files: write them into one")
        yield file, data


def h5py_type(kind: np.dtype[Any]) -> Any:
    """HDF5's own type of numbers that lie in a file as NumPy has them."""
    import h5py

    return h5py.h5t.py_create(kind)


def _datasets(file: Any) -> list[tuple[str, Any]]:
    """Names and datasets of three or four axes, whatever holds them."""
    import h5py

    found: list[tuple[str, Any]] = []

    def look(name: str, entry: Any) -> None:
        is_volume = isinstance(entry, h5py.Dataset) and entry.ndim in (3, 4) and entry.dtype.kind in NUMBER_KINDS
        if is_volume and len(found) < MOST_DATASETS:
            found.append((name, entry))

    file.visititems(look)  # follows no links to other files
    return found
