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
from hagoromo.files.reading import opencv_silenced, reading, tifffile_silenced
from hagoromo.files.whole import whole_file

ELSEWHERE = -1  # of pixels that do not lie one after the other
PIXEL_TYPES = (np.uint8, np.uint16, np.float32)


class TiffPage(NamedTuple):
    """The first image of a TIFF: shape, type of its numbers, where they begin; −1 where they are packed or in tiles."""

    shape: tuple[int, ...]
    kind: np.dtype[Any]
    offset: int

    @property
    def size(self) -> float:
        """Bytes of the pixels."""
        return math.prod(map(float, self.shape)) * self.kind.itemsize


def read_tiff(path: str | Path) -> NDArray:
    """The first image of the file: (height, width[, 3 or 4]), uint8, uint16 or float32, in the order R, G, B, A.

    What is packed is decoded in a process apart. `InputError` if the file is missing, not a TIFF, truncated, of another
    pixel type, or larger than the free memory.
    """
    page = tiff_page(path)
    require(2.0 * page.size, str(path))
    if page.offset == ELSEWHERE:
        image = read_apart(pixels_by_library, path, "TIFF", stated=page.size)["pixels"]
    else:
        stored = np.fromfile(path, page.kind, math.prod(page.shape), offset=page.offset)
        image = stored.astype(page.kind.newbyteorder("="), copy=False).reshape(page.shape)
    if image.shape != page.shape or image.dtype != page.kind.newbyteorder("="):
        raise InputError(f"{path} is cut off or damaged: copy it again")
    return image[..., 0] if image.ndim == 3 and image.shape[2] == 1 else image


def tiff_page(path: str | Path) -> TiffPage:
    """What a TIFF states of its first image, read in a process apart; `InputError` as of `read_tiff`."""
    stated = read_apart(page_by_tifffile, existing_file(path), "TIFF")
    return TiffPage(tuple(map(int, stated["shape"])), np.dtype(str(stated["kind"])), int(stated["offset"]))


def page_by_tifffile(path: Path) -> Mapping[str, NDArray[Any]]:
    """The fields of a `TiffPage`; run by `read_apart`."""
    with _first_page(path) as (file, page):
        kind = np.dtype(page.dtype).newbyteorder(file.byteorder)
        offset = page.dataoffsets[0] if page.is_final else ELSEWHERE
        return {"shape": np.array(page.shape), "kind": np.array(kind.str), "offset": np.array(offset)}


def pixels_by_library(path: Path) -> Mapping[str, NDArray[Any]]:
    """pixels that are not in one piece; run by `read_apart`. OpenCV's libtiff never decodes more than a strip holds."""
    import cv2

    with _first_page(path) as (_, page):
        if not is_packed(page):
            return {"pixels": page.asarray()}
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
def _first_page(source: Path) -> Iterator[tuple[Any, Any]]:
    """The file and its first page, as tifffile has them, whose header is checked."""
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
        size = math.prod(map(float, shape)) * np.dtype(kind).itemsize
        ends = [start + length for start, length in zip(page.dataoffsets, page.databytecounts, strict=True)]
        if max(ends, default=0) > held or (not is_packed(page) and sum(page.databytecounts) < size):
            raise InputError(f"{source} is cut off: copy it again")
        check_density(size, source, PACKED if is_packed(page) else 1.0, f"an image of {str(shape)[:40]}")
        yield file, page


def is_packed(page: Any) -> bool:
    """Whether the pixels of a page of tifffile are compressed."""
    return page.compression != 1
