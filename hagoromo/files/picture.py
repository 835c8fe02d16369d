"""Pictures of cameras and other programs: PNG, JPEG or TIFF, recognised by their first bytes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files import jpeg, png
from hagoromo.files.checks import existing_file, inside
from hagoromo.files.tiff import read_tiff

TIFF_STARTS = (b"II*\0", b"MM\0*")


def read_picture(path: str | Path) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """The stored pixels: (height, width[, 3 or 4]), uint8 or uint16, in the order R, G, B, A; never rotated.

    `InputError` if the file is missing, of another format, truncated, or larger than the free memory.
    """
    with existing_file(path).open("rb") as file:
        start = file.read(len(png.SIGNATURE))
    if start.startswith(png.SIGNATURE):
        return png.read_png(path)
    if start.startswith(jpeg.START):
        return jpeg.read_jpeg(path)
    if start.startswith(TIFF_STARTS):
        image = read_tiff(path)
        if image.dtype == np.float32:
            raise InputError(f"{path} holds floats: a picture has 8 or 16 bits")
        return image
    raise InputError(f"{path} is neither PNG, JPEG nor TIFF: convert it")


def named_picture(folder: str | Path, name: str, suffixes: Sequence[str] = (".png", ".jpg", ".jpeg")) -> Path:
    """The picture `name` in `folder`; where there is none, the first with a suffix added that exists.

    `InputError` where it lies outside `folder`, also by a link.
    """
    named = [inside(folder, name + suffix) for suffix in ("", *suffixes)]
    return next((candidate for candidate in named if candidate.is_file()), named[0])


def picture_size(path: str | Path) -> tuple[int, int]:
    """(height, width) of the PNG or JPEG at `path`, from its header.

    `InputError` if the file is missing or of another format.
    """
    source = existing_file(path)
    with source.open("rb") as file:
        start = file.read(len(png.SIGNATURE))
    if start.startswith(png.SIGNATURE):
        header = png.png_header(source)
        return header.height, header.width
    if start.startswith(jpeg.START):
        return jpeg.frame_header(source)[:2]
    raise InputError(f"{source} is neither PNG nor JPEG: convert it")


def by_name(paths: Sequence[Path]) -> dict[str, Path]:
    """Name → path; files of one name are distinguished by their folder. `InputError` if a file is given twice."""
    names = [path.name for path in paths]
    path_of = {path.name if names.count(path.name) == 1 else str(path): path for path in paths}
    if len(path_of) < len(paths):
        raise InputError("a photograph is given twice: give each once")
    return path_of
