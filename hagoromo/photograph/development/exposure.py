"""Exposure: linear sensor numbers above black of one photograph, read from RAW, TIFF, PNG, EXR or JPEG."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.sensor import MOSAICS
from hagoromo.errors import InputError
from hagoromo.files import raw
from hagoromo.files.exif import Exif, read_exif
from hagoromo.files.exr import read_exr
from hagoromo.files.picture import read_picture
from hagoromo.files.tiff import read_tiff
from hagoromo.least_squares.loss import ROBUST_SCALE
from hagoromo.photograph.development.transfer import Transfer

PICTURES, TIFFS, EXRS = (".png", ".jpg", ".jpeg"), (".tif", ".tiff"), (".exr",)
NO_MOSAIC = "none"  # states that a file with one channel has no mosaic
MOSAIC_CONTRAST = 0.03  # least difference of the four positions of 2 × 2 samples that is noticed as a mosaic
MOSAIC_CERTAINTY = 6.0  # standard errors of it over the tiles of an image
MOSAIC_TILES = 8  # tiles along each side
LINEAR_ROUNDING = 1.0 / 12.0  # [DN²] variance of rounding to whole numbers


class StatedExposure(NamedTuple):
    """Values that the user states and that override those of the file; None: as in the file.

    black, white [DN]; mosaic of a one-channel image, "none" where it has none; transfer: "linear", "srgb", a CSV or a
    curve; exposure_s [s]; iso.
    """

    black: float | None = None
    white: float | None = None
    mosaic: str | None = None
    transfer: str | Path | Transfer | None = None
    exposure_s: float | None = None
    iso: float | None = None


@dataclass(frozen=True, eq=False)
class Exposure:
    """One exposure.

    signal: (height, width) with a mosaic, else (height, width, channels), float32: DN above black, linear in light.
    rounding: variance of the signal by rounding [DN²], a number or one per sample. full: same shape as signal, true
    where the sensor (or the file) is clipped. white: signal of the brightest light [DN]. mosaic: as `Sensor`. exif: the
    settings, including stated ones. unit: signal of the value 1 after one second at ISO 100 [DN]; None: white. curve:
    variance of the signal by an estimated transfer curve [DN²], as `rounding`, but common to all frames.
    """

    signal: NDArray[np.float32]
    rounding: NDArray[np.float32] | float
    full: NDArray[np.bool_]
    white: float
    mosaic: str
    exif: Exif
    name: str = ""
    unit: float | None = None
    curve: NDArray[np.float32] | float = 0.0

    def __post_init__(self) -> None:
        """Check the parts once."""
        if self.signal.ndim != (2 if self.mosaic else 3):
            raise InputError(
                f"{self.name} has shape {self.signal.shape}, which mosaic {self.mosaic!r} does not fit: state another"
            )
        if not np.isfinite(self.signal).all():
            raise InputError(f"{self.name} holds values that are not finite: replace them")
        if not self.white > 0.0:
            raise InputError(
                f"{self.name}: white is {self.white:g} DN above black: state black (--black) below white (--white)"
            )

    @property
    def seconds(self) -> float:
        """Exposure time [s]; 1 if it is unknown."""
        return self.exif.exposure_s or 1.0

    @property
    def iso(self) -> float:
        """ISO speed; 100 if it is unknown."""
        return self.exif.iso or 100.0


def read_exposure(path: str | Path, stated: StatedExposure = StatedExposure()) -> Exposure:  # noqa: B008 - a tuple of None
    """The exposure at `path`. `InputError` for an unknown file format, or 8 bits without a stated transfer."""
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix in raw.RAW_SUFFIXES:
        exposure = _from_raw(path, stated)
    elif suffix in EXRS:
        exposure = _from_light(_exr(path), path, stated)
    elif suffix in (*TIFFS, *PICTURES):
        image = (read_tiff if suffix in TIFFS else read_picture)(path)
        exposure = (_from_light if image.dtype.kind == "f" else _from_numbers)(image, path, stated)
    else:
        known = ", ".join((*raw.RAW_SUFFIXES[:2], *TIFFS, *PICTURES, *EXRS))
        raise InputError(f"{path} is not a photograph of a known format: give RAW or one of {known}")
    exif = exposure.exif
    return replace(
        exposure,
        exif=replace(exif, exposure_s=stated.exposure_s or exif.exposure_s, iso=stated.iso or exif.iso),
        name=path.name,
    )


def planes(samples: NDArray, mosaic: str) -> list[NDArray]:
    """Views (rows, columns) of the samples of one colour: the four positions of a mosaic, else the channels."""
    if mosaic:
        return [samples[row::2, column::2] for row in (0, 1) for column in (0, 1)]
    return [samples[..., channel] for channel in range(samples.shape[2])]


def _from_raw(path: Path, stated: StatedExposure) -> Exposure:
    shot = raw.read_raw(path)
    numbers, white = shot.numbers, stated.white or shot.white
    black = shot.black if stated.black is None else np.full((2, 2), stated.black)
    height, width = numbers.shape[:2]
    floor = np.tile(black, (height // 2 + 1, width // 2 + 1))[:height, :width].astype(np.float32)
    signal = numbers.astype(np.float32) - (floor if shot.mosaic else floor[..., None])
    return Exposure(signal, LINEAR_ROUNDING, numbers >= white, white - float(black.max()), shot.mosaic, shot.exif)


def _from_numbers(image: NDArray, path: Path, stated: StatedExposure) -> Exposure:
    """Exposure from 8 or 16 bits; alpha is ignored."""
    largest = int(np.iinfo(image.dtype).max)
    mosaic = mosaic_of(image, path, stated)
    numbers = image[..., :3] if image.ndim == 3 else image if mosaic else image[..., None]
    transfer = stated.transfer if stated.transfer is not None else "linear" if largest > 255 else None
    if transfer is None:
        raise InputError(
            f"{path} has 8 bits, which are rarely linear: state transfer (--transfer): linear, srgb, estimate or a CSV"
        )
    curve = transfer if isinstance(transfer, Transfer) else Transfer.load(transfer, largest)
    if curve.table.shape[1] not in (1, numbers.shape[2] if numbers.ndim == 3 else 1):
        raise InputError(f"{path} has one channel and its transfer curve three: give a curve with one")
    black, white = stated.black or 0.0, largest if stated.white is None else stated.white
    if not 0.0 <= black < white <= largest:
        raise InputError(f"{path}: black {black:g} must be below white {white:g}, both within 0–{largest} DN")
    light, rounding, spread = curve.light(numbers)
    floor, ceiling = (float(curve.table[round(level)].mean()) for level in (black, white))
    signal, full = light - np.float32(floor), numbers >= white
    return Exposure(signal, rounding, full, ceiling - floor, mosaic, read_exif(path), path.name, curve=spread)


def _from_light(image: NDArray, path: Path, stated: StatedExposure) -> Exposure:
    """Exposure from linear values, which keep their unit; nothing is clipped unless `white` is stated."""
    mosaic = mosaic_of(image, path, stated)
    values = image[..., :3] if image.ndim == 3 else image if mosaic else image[..., None]
    black = stated.black or 0.0
    white = stated.white if stated.white is not None else max(float(values.max(initial=0.0)), 1e-30) + black
    full = values >= stated.white if stated.white is not None else np.zeros(values.shape, np.bool_)
    signal = values.astype(np.float32) - np.float32(black)
    unit = 1.0 if stated.white is None else None
    return Exposure(signal, 0.0, full, white - black, mosaic, read_exif(path), path.name, unit)


def mosaic_of(image: NDArray, path: Path, stated: StatedExposure) -> str:
    """The stated mosaic; `InputError` for an unknown one, or if none is stated and `image` shows one."""
    mosaic = "" if stated.mosaic in (None, NO_MOSAIC) else stated.mosaic or ""
    if mosaic not in MOSAICS:
        raise InputError(
            f"mosaic {mosaic!r} is unknown: choose one of {', '.join((*filter(None, MOSAICS), NO_MOSAIC))}"
        )
    if stated.mosaic is None and (image.ndim == 2 or image.shape[2] == 1):
        contrast = _mosaic_contrast(image.reshape(image.shape[:2]).astype(np.float64))
        if contrast > 0.0:
            raise InputError(
                f"{path} has one channel, and the positions of 2 × 2 samples differ by {100 * contrast:.0f} %, as "
                "behind a mosaic: state mosaic (--mosaic), such as RGGB, or none"
            )
    return mosaic


def _mosaic_contrast(image: NDArray[np.float64]) -> float:
    """Largest relative difference of one of the four positions of 2 × 2 samples from their mean; 0 if not certain."""
    height, width = (n // (2 * MOSAIC_TILES) * 2 for n in image.shape)
    if min(height, width) < 4:
        return 0.0
    above = image[: MOSAIC_TILES * height, : MOSAIC_TILES * width] - np.percentile(image, 0.1)
    cells = above.reshape(MOSAIC_TILES, height // 2, 2, MOSAIC_TILES, width // 2, 2).mean(axis=(1, 4))
    means = np.moveaxis(cells, 1, 2).reshape(-1, 4)  # (tiles, positions)
    bright = means.mean(axis=1) > 0.1 * max(float(means.mean()), 1e-30)
    if bright.sum() < MOSAIC_TILES or not means.mean() > 0.0:
        return 0.0
    off = means[bright] / means[bright].mean(axis=1, keepdims=True) - 1.0
    middle = np.median(off, axis=0)
    error = 1.2533 * ROBUST_SCALE * np.median(np.abs(off - middle), axis=0) / np.sqrt(len(off))  # of a median
    certain = (np.abs(middle) > MOSAIC_CONTRAST) & (np.abs(middle) > MOSAIC_CERTAINTY * error)
    return float(np.abs(middle[certain]).max(initial=0.0))


def _exr(path: Path) -> NDArray[np.float32]:
    layers, _ = read_exr(path)
    for names in (("R", "G", "B"), ("Y",)):
        if set(names) <= set(layers):
            return np.stack([layers[name] for name in names], axis=2)[..., : len(names)]
    raise InputError(f"{path} has the channels {', '.join(layers)}: give R, G and B, or Y")


def alike(exposures: Any, what: str) -> None:
    """Raise `InputError` unless all exposures are of one size and mosaic."""
    first = exposures[0]
    for other in exposures[1:]:
        if other.signal.shape != first.signal.shape or other.mosaic != first.mosaic:
            raise InputError(
                f"{what} of different size or mosaic: {first.name} is {first.signal.shape} {first.mosaic}, "
                f"{other.name} {other.signal.shape} {other.mosaic}: give frames of one camera and format"
            )
