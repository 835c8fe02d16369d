"""Camera RAW, read by LibRaw: the numbers of the sensor before any processing. Never rotated."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.apart import read_apart
from hagoromo.files.checks import check_density, existing_file
from hagoromo.files.exif import Exif, read_exif
from hagoromo.files.memory import require

RAW_SUFFIXES = tuple(
    f".{suffix}"
    for suffix in "dng cr2 cr3 crw nef nrw arw sr2 srf raf orf rw2 pef srw 3fr fff iiq mos mrw erf kdc dcr x3f".split()
)
RAW_BYTES_PER_PIXEL = 8
MOST_PIXELS_PER_BYTE = 1024.0  # lossy JPEG in a DNG 512, lossless JPEG 8


class Raw(NamedTuple):
    """numbers: (height, width) behind a Bayer mosaic, else (height, width, 3), uint16. mosaic: "RGGB", ..., or "".

    black: (2, 2) black level of the first 2 × 2 pixels [DN]. white: saturation level [DN]. exif: the file's settings.
    """

    numbers: NDArray[np.uint16]
    mosaic: str
    black: NDArray[np.float64]
    white: float
    exif: Exif


def read_raw(path: str | Path) -> Raw:
    """The RAW photograph at `path`.

    `InputError` if the file is missing, truncated, larger than the free memory, in a format that LibRaw does not read,
    or has a mosaic other than Bayer's.
    """
    stored = read_apart(raw_by_library, existing_file(path), "camera RAW")
    exif, other = (
        read_exif(path),
        dict(zip(("exposure_s", "iso", "f_number", "focal_mm"), stored["other"], strict=True)),
    )
    known: dict[str, Any] = {
        name: getattr(exif, name) or float(value) or None for name, value in other.items()
    }  # not of TIFF's kind
    return Raw(
        stored["numbers"], str(stored["mosaic"]), stored["black"], float(stored["white"]), replace(exif, **known)
    )


def raw_size(path: str | Path) -> tuple[int, int]:
    """(height, width) [px] of the RAW photograph at `path`; nothing is unpacked. `InputError` as of `read_raw`."""
    height, width = read_apart(size_by_library, existing_file(path), "camera RAW")["size"].tolist()
    return height, width


def size_by_library(path: Path) -> dict[str, NDArray[Any]]:
    """size: (height, width); run by `read_apart`."""
    with _opened(path) as raw:
        return {"size": np.array([raw.sizes.height, raw.sizes.width])}


def raw_by_library(path: Path) -> dict[str, NDArray[Any]]:
    """The fields of a `Raw`, and the settings that LibRaw knows; run by `read_apart`, because LibRaw prints."""
    with _opened(path) as raw:
        require(float(RAW_BYTES_PER_PIXEL) * raw.sizes.raw_height * raw.sizes.raw_width, str(path))
        raw.unpack()
        return _fields(raw, path)


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """The file, whose size is checked."""
    import rawpy

    try:
        with rawpy.RawPy() as raw:
            raw.open_file(str(path))
            height, width = raw.sizes.raw_height, raw.sizes.raw_width
            check_density(float(height) * width, path, MOST_PIXELS_PER_BYTE, f"{width} × {height} pixels")
            yield raw
    except rawpy.LibRawError as error:
        text = error.args[0] if error.args else ""
        text = text.decode("utf-8", "replace") if isinstance(text, bytes) else str(text)
        raise InputError(f"{path} cannot be read as camera RAW, it may be cut off: {text or 'damaged'}") from error


def _fields(raw: Any, path: Path) -> dict[str, NDArray[Any]]:
    image, shot = np.array(raw.raw_image_visible), raw.other
    white = min([raw.white_level, *(w for w in raw.camera_white_level_per_channel or () if w)])
    black = np.asarray(raw.black_level_per_channel, np.float64)
    settings = np.array([shot.shutter_speed, shot.iso_speed, shot.aperture, shot.focal_length], np.float64)
    rest = {"white": np.array(white, np.float64), "other": settings}
    if image.ndim == 3:  # DNG without a mosaic
        return {"numbers": image[..., :3], "mosaic": np.array(""), "black": np.full((2, 2), black[0]), **rest}
    if raw.raw_pattern is None or raw.raw_pattern.shape != (2, 2):
        raise InputError(f"{path} has another mosaic than Bayer's 2 × 2: convert it to a linear TIFF first")
    index = raw.raw_colors_visible[:2, :2]
    mosaic = "".join(chr(raw.color_desc[colour]) for colour in index.ravel())
    if sorted(mosaic) != sorted("RGGB"):
        raise InputError(f"{path} has the mosaic {mosaic}: only R, G, G, B is read, convert it to a linear TIFF first")
    return {"numbers": image, "mosaic": np.array(mosaic), "black": black[index], **rest}
