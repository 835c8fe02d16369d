"""Camera RAW, read by LibRaw: the numbers of the sensor before any processing. Never rotated."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.checks import existing_file
from hagoromo.files.exif import Exif, read_exif
from hagoromo.files.memory import require
from hagoromo.files.silence import silenced

RAW_SUFFIXES = tuple(
    f".{suffix}"
    for suffix in "dng cr2 cr3 crw nef nrw arw sr2 srf raf orf rw2 pef srw 3fr fff iiq mos mrw erf kdc dcr x3f".split()
)
RAW_BYTES_PER_PIXEL = 8


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
    import rawpy

    source = existing_file(path)
    try:
        with silenced(), rawpy.RawPy() as raw:
            raw.open_file(str(source))
            sizes = raw.sizes
            require(float(RAW_BYTES_PER_PIXEL) * sizes.raw_height * sizes.raw_width, str(source))
            raw.unpack()
            return _raw(raw, source)
    except rawpy.LibRawError as error:
        text = error.args[0] if error.args else ""
        text = text.decode("utf-8", "replace") if isinstance(text, bytes) else str(text)
        raise InputError(f"{source} cannot be read as camera RAW, it may be cut off: {text or 'damaged'}") from error


def _raw(raw: Any, path: Path) -> Raw:
    image = np.array(raw.raw_image_visible)
    white = min([raw.white_level, *(w for w in raw.camera_white_level_per_channel or () if w)])
    black = np.asarray(raw.black_level_per_channel, np.float64)
    if image.ndim == 3:  # DNG without a mosaic
        return Raw(image[..., :3], "", np.full((2, 2), black[0]), float(white), _exif(raw, path))
    if raw.raw_pattern is None or raw.raw_pattern.shape != (2, 2):
        raise InputError(f"{path} has another mosaic than Bayer's 2 × 2: convert it to a linear TIFF first")
    index = raw.raw_colors_visible[:2, :2]
    mosaic = "".join(chr(raw.color_desc[colour]) for colour in index.ravel())
    if sorted(mosaic) != sorted("RGGB"):
        raise InputError(f"{path} has the mosaic {mosaic}: only R, G, G, B is read, convert it to a linear TIFF first")
    return Raw(image, mosaic, black[index], float(white), _exif(raw, path))


def _exif(raw: Any, path: Path) -> Exif:
    """The settings in EXIF; those that it lacks, as in files that are not TIFF, from LibRaw."""
    exif, other = read_exif(path), raw.other
    return Exif(
        exif.exposure_s or other.shutter_speed or None,
        exif.iso or other.iso_speed or None,
        exif.f_number or other.aperture or None,
        exif.focal_mm or other.focal_length or None,
        exif.sensor_mm,
        exif.camera,
    )
