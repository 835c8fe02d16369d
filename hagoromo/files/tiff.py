"""TIFF: images of 8 or 16 bits or float, as cameras and other programs write them."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.checks import existing_file, read_bytes
from hagoromo.files.memory import require
from hagoromo.files.png import swapped
from hagoromo.files.reading import reading
from hagoromo.files.silence import opencv_silenced, tifffile_silenced
from hagoromo.files.whole import whole_file

PIXEL_TYPES = (np.uint8, np.uint16, np.float32)


def read_tiff(path: str | Path) -> NDArray:
    """The first image of the file: (height, width[, 3 or 4]), uint8, uint16 or float32, in the order R, G, B, A.

    `InputError` if the file is missing, not a TIFF, truncated, of another pixel type, or larger than the free memory.
    """
    import tifffile

    source = existing_file(path)
    with reading(source, "TIFF"), tifffile_silenced(), tifffile.TiffFile(source) as file:
        page = file.pages.first
        shape, kind = page.shape, page.dtype
        if kind not in PIXEL_TYPES or len(shape) not in (2, 3) or (len(shape) == 3 and shape[2] not in (1, 3, 4)):
            raise InputError(
                f"{source} holds {kind} of shape {str(shape)[:40]}: 8, 16 bits or float, 1 or 3 channels are read"
            )
        if page.bitspersample != 8 * np.dtype(kind).itemsize:
            raise InputError(
                f"{source} has {page.bitspersample} bits a sample: 8, 16 bits or float are read, convert it"
            )
        size = math.prod(map(float, shape)) * np.dtype(kind).itemsize
        require(2.0 * size, str(source))
        ends = [start + length for start, length in zip(page.dataoffsets, page.databytecounts, strict=True)]
        plain = page.compression == tifffile.COMPRESSION.NONE
        if max(ends, default=0) > source.stat().st_size or (plain and sum(page.databytecounts) < size):
            raise InputError(f"{source} is cut off: copy it again")
        image = page.asarray() if plain else _unpacked(source)
    if image.shape != shape or image.dtype != kind:
        raise InputError(f"{source} is cut off or damaged: copy it again")
    return image[..., 0] if image.ndim == 3 and image.shape[2] == 1 else image


def write_tiff(path: str | Path, image: NDArray[np.uint8] | NDArray[np.uint16], profile: bytes | None = None) -> None:
    """Write display values (height, width[, 3]), 8 or 16 bits, packed without loss; profile: an ICC profile of them."""
    import tifffile

    with whole_file(path, force=True) as partial:
        kind = "rgb" if image.ndim == 3 else "minisblack"
        tifffile.imwrite(partial, image, photometric=kind, compression="deflate", software="", datetime=False,
                         iccprofile=profile)  # fmt: skip


def _unpacked(path: Path) -> NDArray:
    """Decode by OpenCV, whose libtiff knows all compressions and never decodes more than a strip holds."""
    import cv2

    with opencv_silenced():
        image = cv2.imdecode(np.frombuffer(read_bytes(path), np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None:
        raise ValueError("its compressed pixels are damaged")
    return swapped(image)
