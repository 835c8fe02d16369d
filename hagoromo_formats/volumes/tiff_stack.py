"""TIFF stacks: pages of one file (by tifffile; packed ones by OpenCV), or a folder of one-page files in their order.

A page is a layer of z, its first row y = 0. Edges of voxels are those of ImageJ's metadata, where a file has them.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.apart import Arrays
from hagoromo.files.checks import PACKED, check_density, existing_file, inside, read_bytes
from hagoromo.files.memory import require
from hagoromo.files.reading import opencv_silenced, reading, tifffile_silenced
from hagoromo.files.tiff import is_packed, read_tiff, tiff_page
from hagoromo.files.volume_file import NUMBER_KINDS, Later, VolumeFile, grid_matrix
from hagoromo_formats.volumes.apart_volume import ELSEWHERE, header_arrays, volume_apart

SUFFIXES = (".tif", ".tiff")
UNITS = {"um": 1e-6, "µm": 1e-6, "micron": 1e-6, "mm": 1e-3, "cm": 1e-2, "m": 1.0, "nm": 1e-9}


def read_tiff_stack(path: str | Path) -> VolumeFile:
    """The volume of a file of several pages, or of a folder of files of one page each."""
    path = Path(path)
    if path.is_dir():
        return _folder(path)
    return volume_apart(existing_file(path), "TIFF", header_by_tifffile, numbers_by_library)


def is_stack(path: Path) -> bool:
    """Whether a folder holds layers: two TIFF files or more."""
    return path.is_dir() and len(slices(path)) > 1


def slices(folder: Path) -> list[Path]:
    """The TIFF files of a folder, by name; numbers in names count as numbers."""
    named = [file for file in folder.iterdir() if file.suffix.lower() in SUFFIXES]
    return sorted(named, key=lambda file: [int(w) if w.isdigit() else w for w in re.split(r"(\d+)", file.name)])


def _folder(folder: Path) -> VolumeFile:
    files = [inside(folder, file.name) for file in slices(folder)]
    if len(files) < 2:
        raise InputError(f"{folder} has {len(files)} TIFF files: give a folder of two or more layers")
    first = tiff_page(files[0])
    layer = first.shape[:2] if first.shape[2:] == (1,) else first.shape
    kind = first.kind.newbyteorder("=")

    def read() -> NDArray[Any]:
        require(2.0 * len(files) * first.size, str(folder))
        values = np.empty((len(files), *layer), kind)
        for k, file in enumerate(files):
            page = read_tiff(file)
            if page.shape != layer or page.dtype != kind:
                raise InputError(f"{file} is of another size or type than {files[0].name}: give layers of one kind")
            values[k] = page
        return values

    return VolumeFile(Later((len(files), *layer), kind, read), None, str(folder))


def header_by_tifffile(path: Path, _: str) -> Arrays:
    """What the file states; run by `read_apart`."""
    with _series(path) as (file, series, page):
        offset = series.dataoffset
        kind = np.dtype(page.dtype).newbyteorder(file.byteorder)
        shape = (len(series.pages), *page.shape)
        return header_arrays(shape, kind, _matrix(file, page), ELSEWHERE if offset is None else offset)


def numbers_by_library(path: Path, _: str) -> Arrays:
    """values (nz, ny, nx) of pages that are packed, or not in one piece; run by `read_apart`."""
    with _series(path) as (file, series, page):
        shape = (len(series.pages), *page.shape)
        require(3.0 * math.prod(map(float, shape)) * page.dtype.itemsize, str(path))
        kind = np.dtype(page.dtype).newbyteorder(file.byteorder)
        if not is_packed(page):
            return {"values": series.asarray().reshape(shape).astype(kind)}
    return {"values": _unpacked(path, shape, kind.newbyteorder("=")).astype(kind)}


@contextmanager
def _series(path: Path) -> Iterator[tuple[Any, Any, Any]]:
    """The file, its first series of pages, and one of them, as tifffile has them, whose headers are checked."""
    import tifffile

    with reading(path, "TIFF"), tifffile_silenced(), tifffile.TiffFile(path) as file:
        series = file.series[0]
        page, count = series.keyframe, len(series.pages)
        if len(page.shape) != 2 or count < 2 or page.dtype is None or page.dtype.kind not in NUMBER_KINDS:
            raise InputError(f"{path} has {count} pages of {str(page.shape)[:40]}: a stack has two or more of grey")
        held, packed = path.stat().st_size, is_packed(page)
        if not packed and sum(sum(each.databytecounts) for each in series.pages if each is not None) > held:
            raise InputError(f"{path} is cut off: copy it again")
        size = count * math.prod(map(float, page.shape)) * page.dtype.itemsize
        check_density(size, path, PACKED if packed else 1.0, f"{count} pages of {str(page.shape)[:40]}")
        yield file, series, page


def _unpacked(path: Path, shape: tuple[int, ...], kind: Any) -> NDArray[Any]:
    import cv2

    with reading(path, "TIFF"), opencv_silenced():
        done, pages = cv2.imdecodemulti(np.frombuffer(read_bytes(path), np.uint8), cv2.IMREAD_UNCHANGED)
        if not done or len(pages) != shape[0] or any(page.shape != shape[1:] or page.dtype != kind for page in pages):
            raise ValueError("its packed pages are damaged")
    return np.stack(pages)


def _matrix(file: Any, page: Any) -> NDArray[np.float64] | None:
    """ImageJ writes pixels a unit along x and y, and the spacing of layers."""
    facts = file.imagej_metadata or {}
    unit, spacing = UNITS.get(str(facts.get("unit", ""))), facts.get("spacing")
    resolution = [page.tags[name].value for name in ("XResolution", "YResolution") if name in page.tags]
    if unit is None or spacing is None or len(resolution) < 2 or not all(a and b for a, b in resolution):
        return None
    return grid_matrix([*(b / a for a, b in resolution), abs(float(spacing))], unit=unit)
