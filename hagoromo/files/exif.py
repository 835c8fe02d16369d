"""EXIF: the camera's settings of an exposure, read from JPEG, PNG, TIFF and the camera RAW formats based on TIFF.

JPEG and PNG hold EXIF as an embedded TIFF, so tifffile (a dependency of scikit-image) reads all of them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

from hagoromo.errors import InputError
from hagoromo.files import jpeg, png
from hagoromo.files.checks import existing_file
from hagoromo.files.reading import reading, tifffile_silenced

TIFF = (b"II*\0", b"MM\0*", b"IIRO", b"IIU\0")  # first bytes of a file; the last two: Olympus, Panasonic
MM_PER_UNIT = {2: 25.4, 3: 10.0, 4: 1.0, 5: 1e-3}  # FocalPlaneResolutionUnit: inch, cm, mm, µm
FULL_FRAME_MM = 36.0  # [mm] width of the film that FocalLengthIn35mmFilm refers to
SENSOR_ROUNDING = 1.25  # factor between two widths of one sensor: film is 3:2, its focal length is in whole mm
STOPS_ROUNDING = 0.5  # stops between two statements of one exposure time
HEAD_BYTES = 64 * 2**20  # first bytes of a JPEG or PNG that are searched for EXIF


@dataclass(frozen=True)
class Exif:
    """Settings of one exposure; None where the file does not state them.

    exposure_s [s]; iso; f_number (focal length over aperture); focal_mm [mm]; sensor_mm: width of the sensor [mm];
    camera: maker and model. lens: its name. sensor_conflict, exposure_conflict: what is stated in two ways that differ,
    in words; "" where nothing is.
    """

    exposure_s: float | None = None
    iso: float | None = None
    f_number: float | None = None
    focal_mm: float | None = None
    sensor_mm: float | None = None
    camera: str = ""
    sensor_conflict: str = ""
    exposure_conflict: str = ""
    lens: str = ""

    def focal_px(self, width: int) -> float | None:
        """Focal length [px] of an image of `width` pixels; None if focal length or sensor width is unknown."""
        if self.focal_mm is None or self.sensor_mm is None:
            return None
        return self.focal_mm / self.sensor_mm * width


def read_exif(path: str | Path) -> Exif:
    """The EXIF of the file at `path`; all fields are None if it has none or a damaged one."""
    import tifffile

    source = _tiff_within(existing_file(path))
    if source is None:
        return Exif()
    try:
        with reading(path, "EXIF"), tifffile_silenced(), tifffile.TiffFile(source) as file:
            tags = {tag.name: tag.value for tag in file.pages.first.tags}
    except InputError:
        return Exif()
    inner = tags.get("ExifTag")
    return _exif({**tags, **(inner if isinstance(inner, Mapping) else {})})


def _tiff_within(path: Path) -> Path | BytesIO | None:
    """The file itself if it is a TIFF, else the TIFF embedded in it; None if there is none."""
    with path.open("rb") as file:
        start = file.read(8)
        if start.startswith(TIFF):
            return path
        if not start.startswith((jpeg.START, png.SIGNATURE)):
            return None
        data = start + file.read(min(HEAD_BYTES, path.stat().st_size))
    segment = jpeg.exif_segment(data) if data.startswith(jpeg.START) else png.exif_chunk(data)
    return None if segment is None else BytesIO(segment)


def _exif(tags: Mapping[str, Any]) -> Exif:
    focal, film = _number(tags.get("FocalLength")), _number(tags.get("FocalLengthIn35mmFilm"))
    dots, pixels = _number(tags.get("FocalPlaneXResolution")), _number(tags.get("PixelXDimension"))
    unit = MM_PER_UNIT.get(int(_number(tags.get("FocalPlaneResolutionUnit")) or 2))
    plane = pixels * unit / dots if dots and pixels and unit else None
    equivalent = FULL_FRAME_MM * focal / film if focal and film else None
    maker, model = (str(tags.get(key, "")).strip() for key in ("Make", "Model"))
    return Exif(
        _number(tags.get("ExposureTime")),
        _number(tags.get("ISOSpeedRatings", tags.get("PhotographicSensitivity"))),
        _number(tags.get("FNumber")),
        focal,
        plane or equivalent,
        model if model.startswith(maker) else f"{maker} {model}".strip(),
        _sensor_conflict(plane, equivalent),
        _exposure_conflict(tags),
        str(tags.get("LensModel", "")).strip()[:200],
    )


def _sensor_conflict(plane: float | None, equivalent: float | None) -> str:
    """Two widths of the sensor that differ by more than their rounding explains."""
    if plane and equivalent and abs(math.log(plane / equivalent)) > math.log(SENSOR_ROUNDING):
        return f"its sensor is {plane:.3g} mm wide by its resolution and {equivalent:.3g} mm by the film's focal length"
    return ""


def _exposure_conflict(tags: Mapping[str, Any]) -> str:
    """Two exposure times that differ by more than their rounding explains."""
    seconds, stops = _number(tags.get("ExposureTime")), _fraction(tags.get("ShutterSpeedValue"))
    if seconds and stops is not None and abs(math.log2(seconds) + stops) > STOPS_ROUNDING:
        return f"its exposure time is {seconds:.3g} s by one tag and {2.0**-stops:.3g} s by another"
    return ""


def _fraction(value: Any) -> float | None:
    """A number of any sign from a tag; None for anything else."""
    figure = _figure(value)
    return figure if figure is not None and abs(figure) < 64.0 else None


def _number(value: Any) -> float | None:
    """A positive number from a tag; None for anything else."""
    figure = _figure(value)
    return figure if figure is not None and 0.0 < figure < 1e12 else None


def _figure(value: Any) -> float | None:
    """A tag as a number; it may be a fraction (numerator, denominator)."""
    try:
        fraction: Any = value if isinstance(value, tuple) and len(value) == 2 else (value, 1.0)
        return float(fraction[0]) / float(fraction[1])
    except (TypeError, ValueError, ZeroDivisionError, OverflowError):
        return None
