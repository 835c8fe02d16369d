"""NIfTI (.nii, .nii.gz), by nibabel: the header's matrix is the world (right, anterior, superior), as it is."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from hagoromo.errors import InputError
from hagoromo.files.apart import Arrays
from hagoromo.files.checks import DEFLATE, check_density, existing_file
from hagoromo.files.memory import require
from hagoromo.files.reading import library, nibabel_silenced, reading
from hagoromo.files.volume_file import MM, VolumeFile
from hagoromo_formats.volumes.apart_volume import ELSEWHERE, header_arrays, volume_apart

UNITS = {"mm": MM, "unknown": MM, "meter": 1.0, "micron": 1e-6}
BYTES = 10.0  # of a number: as stored, and scaled to float64 by slope and intercept
PACKED = (".gz",)


def read_nifti(path: str | Path) -> VolumeFile:
    """The volume in a file; whole numbers with a slope are the numbers that these stand for."""
    library("nibabel")
    return volume_apart(existing_file(path), "NIfTI", header_by_nibabel, numbers_by_nibabel)


def header_by_nibabel(path: Path, _: str) -> Arrays:
    """What the header states; run by `read_apart`."""
    with _opened(path) as image:
        shape = _axes(image, path)
        size = math.prod(map(float, shape)) * image.get_data_dtype().itemsize
        packed = path.suffix.lower() in PACKED
        check_density(size, path, DEFLATE if packed else 1.0, f"an array of {str(shape)[:60]}")
        matrix = np.array(image.affine, float)
        matrix[:3] *= UNITS.get(image.header.get_xyzt_units()[0], MM)
        plain = not packed and not _is_scaled(image) and len(shape) == 3
        return header_arrays(
            shape[2::-1] + shape[3:], _kind(image), matrix, image.dataobj.offset if plain else ELSEWHERE
        )


def numbers_by_nibabel(path: Path, _: str) -> Arrays:
    """values (nz, ny, nx[, components]); run by `read_apart`."""
    with _opened(path) as image:
        shape = _axes(image, path)
        require(BYTES * math.prod(map(float, shape)), str(path))
        values = np.asanyarray(image.dataobj).reshape(shape).astype(_kind(image), copy=False)
        return {"values": np.moveaxis(values, (0, 1, 2), (2, 1, 0))}


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    nibabel = library("nibabel")
    with reading(path, "NIfTI"), nibabel_silenced():
        yield nibabel.Nifti1Image.from_filename(str(path))


def _axes(image: Any, path: Path) -> tuple[int, ...]:
    """(nx, ny, nz[, components]); `InputError` for another array, and for colours."""
    shape = tuple(image.shape)
    while len(shape) > 3 and shape[-1] == 1:
        shape = shape[:-1]
    if len(shape) not in (3, 5) or (len(shape) == 5 and shape[3] != 1):
        raise InputError(f"{path} is an array of {str(image.shape)[:60]}: a volume has three axes")
    if image.get_data_dtype().fields:
        raise InputError(f"{path} holds colours: give a volume of numbers")
    return shape[:3] + shape[4:]


def _is_scaled(image: Any) -> bool:
    return (image.dataobj.slope, image.dataobj.inter) != (1.0, 0.0)


def _kind(image: Any) -> np.dtype[Any]:
    """Type of the numbers when slope and intercept are applied."""
    return np.dtype(np.float64) if _is_scaled(image) else image.dataobj.dtype
