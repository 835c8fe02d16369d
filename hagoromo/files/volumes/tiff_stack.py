"""TIFF stacks: pages of one file (by tifffile; packed ones by OpenCV), or a folder of one-page files in their order.

A page is a layer of z, its first row y = 0. Edges of voxels are those of ImageJ's metadata, where a file has them.
"""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.checks import existing_file, inside, read_bytes
from hagoromo.files.memory import require
from hagoromo.files.reading import reading
from hagoromo.files.silence import opencv_silenced, tifffile_silenced
from hagoromo.files.tiff import read_tiff
from hagoromo.files.volumes.volume_file import NUMBER_KINDS, VolumeFile, grid_matrix

SUFFIXES = (".tif", ".tiff")
UNITS = {"um": 1e-6, "µm": 1e-6, "micron": 1e-6, "mm": 1e-3, "cm": 1e-2, "m": 1.0, "nm": 1e-9}


def read_tiff_stack(path: str | Path) -> VolumeFile:
    """The volume of a file of several pages, or of a folder of files of one page each."""
    path = Path(path)
    return _folder(path) if path.is_dir() else _file(existing_file(path))


def slices(folder: Path) -> list[Path]:
    """The TIFF files of a folder, by name; numbers in names count as numbers."""
    named = [file for file in folder.iterdir() if file.suffix.lower() in SUFFIXES]
    return sorted(named, key=lambda file: [int(w) if w.isdigit() else w for w in re.split(r"(\d+)", file.name)])


def _folder(folder: Path) -> VolumeFile:
    files = [inside(folder, file.name) for file in slices(folder)]
    if len(files) < 2:
        raise InputError(f"{folder} has {len(files)} TIFF files: give a folder of two or more layers")
    first = read_tiff(files[0])
    require(2.0 * len(files) * first.nbytes, str(folder))
    values = np.empty((len(files), *first.shape), first.dtype)
    for k, file in enumerate(files):
        layer = read_tiff(file)
        if layer.shape != first.shape or layer.dtype != first.dtype:
            raise InputError(f"{file} is of another size or type than {files[0].name}: give layers of one kind")
        values[k] = layer
    return VolumeFile(values, None, str(folder))


def _file(path: Path) -> VolumeFile:
    import tifffile

    with reading(path, "TIFF"), tifffile_silenced(), tifffile.TiffFile(path) as file:
        series = file.series[0]
        page, count = series.keyframe, len(series.pages)
        shape = (count, *page.shape)
        if len(shape) != 3 or count < 2 or page.dtype is None or page.dtype.kind not in NUMBER_KINDS:
            raise InputError(f"{path} has {count} pages of {str(page.shape)[:40]}: a stack has two or more of grey")
        require(3.0 * math.prod(map(float, shape)) * page.dtype.itemsize, str(path))
        plain = page.compression == tifffile.COMPRESSION.NONE
        if plain and sum(sum(each.databytecounts) for each in series.pages if each is not None) > path.stat().st_size:
            raise InputError(f"{path} is cut off: copy it again")
        values = series.asarray().reshape(shape) if plain else _unpacked(path, shape, page.dtype)
        return VolumeFile(values, _matrix(file, page), str(path))


def _unpacked(path: Path, shape: tuple[int, ...], kind: Any) -> NDArray[Any]:
    import cv2

    with opencv_silenced():
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
