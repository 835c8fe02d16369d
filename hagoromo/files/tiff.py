"""TIFF: images of 8 or 16 bits or float, as cameras and other programs write them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.apart import read_apart
from hagoromo.files.checks import PACKED, check_density, existing_file, read_bytes
from hagoromo.files.memory import require
from hagoromo.files.png import swapped
from hagoromo.files.reading import reading
from hagoromo.files.silence import opencv_silenced, tifffile_silenced
from hagoromo.files.whole import whole_file

PIXEL_TYPES = (np.uint8, np.uint16, np.float32)


class TiffPage(NamedTuple):
    """The first image of a TIFF: shape, kind of numbers, whether they are packed."""

    shape: tuple[int, ...]
    kind: np.dtype[Any]
    packed: bool


def read_tiff(path: str | Path) -> NDArray:
    """The first image of the file: (height, width[, 3 or 4]), uint8, uint16 or float32, in the order R, G, B, A.

    What is packed is decoded in a process apart. `InputError` if the file is missing, not a TIFF, truncated, of another
    pixel type, or larger than the free memory.
    """
    source = existing_file(path)
    with _first_page(source) as page:
        shape, kind = page.shape, np.dtype(page.dtype)
        size = _size(page)
        require(2.0 * size, str(source))
        image = None if _is_packed(page) else page.asarray()
    if image is None:
        image = read_apart(pixels_by_opencv, source, "TIFF", stated=size)["pixels"]
    if image.shape != shape or image.dtype != kind:
        raise InputError(f"{source} is cut off or damaged: copy it again")
    return image[..., 0] if image.ndim == 3 and image.shape[2] == 1 else image


def tiff_page(path: str | Path) -> TiffPage:
    """What the header of a TIFF states of its first image; `InputError` as of `read_tiff`, but for the pixels."""
    source = existing_file(path)
    with _first_page(source) as page:
        return TiffPage(page.shape, np.dtype(page.dtype), _is_packed(page))


def pixels_by_opencv(path: Path) -> Mapping[str, NDArray[Any]]:
    """pixels, of packed ones; run by `read_apart`. OpenCV's libtiff never decodes more than a strip holds."""
    import cv2

    with reading(path, "TIFF"), opencv_silenced():
        image = cv2.imdecode(np.frombuffer(read_bytes(path), np.uint8), cv2.IMREAD_UNCHANGED)
        if image is None:
            raise ValueError("its compressed pixels are damaged")
    return {"pixels": swapped(image)}


def write_tiff(path: str | Path, image: NDArray[np.uint8] | NDArray[np.uint16], profile: bytes | None = None) -> None:
    """Write display values (height, width[, 3]), 8 or 16 bits, packed without loss; profile: an ICC profile of them."""
    import tifffile

    with whole_file(path, force=True) as partial:
        kind = "rgb" if image.ndim == 3 else "minisblack"
        tifffile.imwrite(partial, image, photometric=kind, compression="deflate", software="", datetime=False,
                         iccprofile=profile)  # fmt: skip


@contextmanager
def _first_page(source: Path) -> Iterator[Any]:
    """The first page, as tifffile has it, whose header is checked."""
    import tifffile

    with reading(source, "TIFF"), tifffile_silenced(), tifffile.TiffFile(source) as file:
        page = file.pages.first
        shape, kind, held = page.shape, page.dtype, source.stat().st_size
        if kind not in PIXEL_TYPES or len(shape) not in (2, 3) or (len(shape) == 3 and shape[2] not in (1, 3, 4)):
            raise InputError(
                f"{source} holds {kind} of shape {str(shape)[:40]}: 8, 16 bits or float, 1 or 3 channels are read"
            )
        if page.bitspersample != 8 * np.dtype(kind).itemsize:
            raise InputError(
                f"{source} has {page.bitspersample} bits a sample: 8, 16 bits or float are read, convert it"
            )
        ends = [start + length for start, length in zip(page.dataoffsets, page.databytecounts, strict=True)]
        if max(ends, default=0) > held or (not _is_packed(page) and sum(page.databytecounts) < _size(page)):
            raise InputError(f"{source} is cut off: copy it again")
        check_density(_size(page), source, PACKED, f"an image of {str(shape)[:40]}")
        yield page


def _size(page: Any) -> float:
    """Bytes of the pixels."""
    return math.prod(map(float, page.shape)) * np.dtype(page.dtype).itemsize


def _is_packed(page: Any) -> bool:
    return page.compression != 1
