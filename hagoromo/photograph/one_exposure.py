"""One exposure: the linear light of a single file, with little memory, and its variance as a model.

Enters: an `Exposure` (RAW, TIFF, PNG, JPEG) and the noise of its sensor. Leaves: values over the white level, with the
mosaic interpolated. `develop` does more with more memory: brackets, a test of linearity, noise from pairs of frames.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.sensor import BILINEAR
from hagoromo.errors import InputError
from hagoromo.files.exif import Exif, read_exif
from hagoromo.files.picture import read_picture
from hagoromo.files.tiff import read_tiff
from hagoromo.photograph.development.exposure import (
    LINEAR_ROUNDING,
    PICTURES,
    TIFFS,
    Exposure,
    StatedExposure,
    mosaic_of,
    planes,
    read_exposure,
)
from hagoromo.photograph.development.master import Dark, Flat
from hagoromo.photograph.development.noise import Noise
from hagoromo.photograph.development.transfer import Transfer
from hagoromo.photograph.variance_model import VarianceModel

NOISE_SIDE = 768  # [px] side of the squares from which the noise is estimated
LINES_TOGETHER = 256  # whose numbers are looked up at once
KNOTS = 65  # of the variance of display-encoded numbers
SAME_ISO = 1e-3  # largest relative difference of equal ISO speeds
HOT_TIMES, HOT_DEVIATIONS = 4.0, 10.0  # of its brightest neighbour, above it: as `master.odd_samples` has them


class ExposureFrame(NamedTuple):
    """An exposure, the curve that linearised it (None: linear numbers or light), and its noise-free rounding apart.

    The exposure's own `rounding` is 0 where a curve linearised it: the variance model has it as a curve.
    """

    exposure: Exposure
    transfer: Transfer | None


class ExposureLight(NamedTuple):
    """values: (height, width, C) float32, the white level as 1 (light in files keeps its unit). valid: (height, width).

    variance: of the values. hot: share of samples that stand out as hot ones do.
    """

    values: NDArray[np.float32]
    valid: NDArray[np.bool_]
    variance: VarianceModel
    hot: float


def read_frame(path: Path, stated: StatedExposure, middle: bool = False) -> ExposureFrame:
    """The frame at `path`; middle: of its middle alone, a square of NOISE_SIDE, with the rounding of each sample.

    `InputError` as `read_exposure` raises it, such as for 8 bits without a stated transfer.
    """
    if path.suffix.lower() not in (*PICTURES, *TIFFS):
        exposure = read_exposure(path, stated)
        return ExposureFrame(_middle(exposure) if middle else exposure, None)
    image = (read_tiff if path.suffix.lower() in TIFFS else read_picture)(path)
    if image.dtype.kind == "f":
        exposure = read_exposure(path, stated)
        return ExposureFrame(_middle(exposure) if middle else exposure, None)
    levels = stated_levels(image, path, stated)
    if middle:
        image = image[_middle_of(image.shape)]
    numbers = image[..., :3] if image.ndim == 3 else image if levels.mosaic else image[..., None]
    full = numbers >= levels.white
    if image.ndim == 3 and image.shape[2] == 4:
        full |= (image[..., 3] < np.iinfo(image.dtype).max)[..., None]
    rounding: NDArray[np.float32] | float = LINEAR_ROUNDING
    if levels.transfer is None:
        signal = numbers.astype(np.float32) - np.float32(levels.black)
        ceiling = levels.white - levels.black
    else:
        floor, ceiling = (float(levels.transfer.table[round(level)].mean()) for level in (levels.black, levels.white))
        signal, ceiling = _looked_up(levels.transfer, numbers, floor), ceiling - floor
        rounding = levels.transfer.light(numbers)[1] if middle else 0.0
    exposure = Exposure(signal, rounding, full, ceiling, levels.mosaic, Exif(), path.name)
    return ExposureFrame(exposure, levels.transfer)


class SensorLevels(NamedTuple):
    """black, white [DN], the curve of the numbers (None: linear) and the mosaic ("": none)."""

    black: float
    white: float
    transfer: Transfer | None
    mosaic: str


def stated_levels(image: NDArray, path: Path, stated: StatedExposure) -> SensorLevels:
    """The levels of 8 or 16 bits; `InputError` for 8 bits without a transfer, levels that make none, and a mosaic that
    shows and is not stated.
    """
    largest = int(np.iinfo(image.dtype).max)
    mosaic = mosaic_of(image, path, stated)
    if mosaic and image.ndim == 3 and image.shape[2] >= 3:
        raise InputError(f"{path} has three channels and no mosaic: omit mosaic (--mosaic)")
    if stated.transfer is None and largest <= 255:
        raise InputError(
            f"{path} has 8 bits, which are rarely linear: develop it first, or state transfer (--transfer): linear, "
            "srgb or a CSV"
        )
    black, white = stated.black or 0.0, float(largest if stated.white is None else stated.white)
    if not 0.0 <= black < white <= largest:
        raise InputError(f"{path}: black {black:g} must be below white {white:g}, both within 0–{largest} DN")
    if stated.transfer is None or stated.transfer == "linear":
        return SensorLevels(black, white, None, mosaic)
    curve = stated.transfer if isinstance(stated.transfer, Transfer) else Transfer.load(stated.transfer, largest)
    if len(curve.table) != largest + 1:
        raise InputError(
            f"{path} has numbers up to {largest} and its transfer curve {len(curve.table) - 1}: give another"
        )
    if curve.table.shape[1] not in (1, image.shape[2] if image.ndim == 3 else 1):
        raise InputError(f"{path} has one channel and its transfer curve three: give a curve with one")
    return SensorLevels(black, white, curve, mosaic)


def _looked_up(transfer: Transfer, numbers: NDArray, floor: float) -> NDArray[np.float32]:
    """The light of `numbers` (height, width, C) less `floor`, a few lines at a time."""
    table, signal = (transfer.table - floor).astype(np.float32), np.empty(numbers.shape, np.float32)
    for top in range(0, len(numbers), LINES_TOGETHER):
        lines = np.s_[top : top + LINES_TOGETHER]
        for channel in range(numbers.shape[2]) if numbers.ndim == 3 else (0,):
            place = (*((lines, slice(None), channel) if numbers.ndim == 3 else (lines,)),)
            signal[place] = table[:, channel % table.shape[1]][numbers[place]]
    return signal


def light_of(frame: ExposureFrame, noise: Noise, dark: Dark | None = None, flat: Flat | None = None) -> ExposureLight:
    """The light of one frame, less a dark frame and over a flat field, where they are given; noise: of its sensor."""
    exposure, transfer = frame
    unit = exposure.unit or exposure.white
    if dark is not None:
        exposure = replace(exposure, signal=exposure.signal - dark.signal)
    model = _variance(exposure, noise, transfer, unit, dark)
    hot = hot_samples(exposure, model.variance.max(axis=0), unit, model)
    if dark is not None:
        hot |= dark.hot
    spoilt, signal = exposure.full | hot, exposure.signal * np.float32(1.0 / unit)
    if flat is not None:
        spoilt, signal = spoilt | ~flat.usable, signal / np.where(flat.usable, flat.share, np.float32(1.0))
        model = model.over(flat)
    signal = np.asarray(signal, np.float32)
    if exposure.mosaic:
        values, valid = interpolated(signal, exposure.mosaic), ~spoilt_by(spoilt)
    else:
        values, valid = signal, np.asarray(~spoilt.any(axis=2), np.bool_)
    return ExposureLight(values, valid, model, float(hot.mean()))


def light_with_gaps(exposure: Exposure) -> NDArray[np.float32]:
    """(height, width, C) light of an exposure, the white level as 1, and NaN where it is clipped."""
    signal = exposure.signal * np.float32(1.0 / exposure.white)
    values = interpolated(signal, exposure.mosaic) if exposure.mosaic else signal
    clipped = spoilt_by(exposure.full) if exposure.mosaic else exposure.full.any(axis=2)
    values[clipped] = np.nan
    return values


def middles_of(paths: Sequence[Path], stated: StatedExposure, iso: float | None = None) -> list[Exposure]:
    """The middles of files, from which the noise of their camera is estimated, with the settings that they state.

    `InputError` for a file of another ISO than `iso`.
    """
    found = []
    for path in paths:
        middle, exif = read_frame(path, stated, middle=True).exposure, read_exif(path)
        own = middle.exif.iso or exif.iso
        if iso is not None and own is not None and abs(own / iso - 1.0) > SAME_ISO:
            raise InputError(f"{path.name} has ISO {own:g} and the photographs {iso:g}: their noise is not the same")
        seconds = middle.exif.exposure_s or exif.exposure_s
        found.append(replace(middle, exif=replace(exif, exposure_s=seconds, iso=own)))
    return found


def hot_samples(
    exposure: Exposure, variance: NDArray[np.float64], unit: float, model: VarianceModel
) -> NDArray[np.bool_]:
    """Isolated bright samples, by the rule of `master.odd_samples`; OpenCV's dilation makes it fast.

    variance: of the channel with the most, at the knots of `model`.
    """
    import cv2

    ring = np.array([[1, 1, 1], [1, 0, 1], [1, 1, 1]], np.uint8)
    odd = np.zeros(exposure.signal.shape, np.bool_)
    for values, full, out in zip(
        *(planes(a, exposure.mosaic) for a in (exposure.signal, exposure.full, odd)), strict=True
    ):
        plane = np.where(full, np.float32(np.inf), values)
        brightest = np.asarray(cv2.dilate(np.ascontiguousarray(plane), ring, borderType=cv2.BORDER_REPLICATE))
        candidates = ~full & (plane > HOT_TIMES * brightest)
        rows, columns = np.nonzero(candidates)
        bright, around = plane[rows, columns] / unit, brightest[rows, columns] / unit
        deviation = np.sqrt(np.interp(bright, model.value, variance))
        out[rows, columns] = bright - around > HOT_DEVIATIONS * deviation
    return odd


def _variance(
    exposure: Exposure, noise: Noise, transfer: Transfer | None, unit: float, dark: Dark | None
) -> VarianceModel:
    """Shot, read and rounding noise over the value, for each channel; with that of a usual dark frame."""
    channels = 3 if exposure.mosaic else exposure.signal.shape[2]
    below = 0.0 if dark is None else max(float(np.median(dark.signal)), 0.0)
    known = 0.0 if dark is None else float(np.median(dark.variance))
    if transfer is None:
        rounding = 0.0 if exposure.unit is not None else LINEAR_ROUNDING
        signal = np.array([0.0, exposure.white])
        rows = np.broadcast_to(noise.variance(signal + below, rounding + known), (channels, 2))
        return VarianceModel(signal / unit, rows / unit**2, exposure.mosaic)
    numbers = np.arange(len(transfer.table))
    signal = exposure.white * np.linspace(0.0, 1.0, KNOTS) ** 2  # the curves bend most near black
    rows = []
    for channel in range(channels):
        own = transfer.table[:, channel % transfer.table.shape[1]]
        error = 0.0 if transfer.error is None else transfer.error[:, channel % transfer.error.shape[1]] ** 2
        step = np.gradient(own, numbers) ** 2 / 12.0 + error
        floor = own[-1] - exposure.white
        rows.append(noise.variance(signal + below, np.interp(signal + floor + below, own, step) + known))
    return VarianceModel(signal / unit, np.stack(rows) / unit**2, exposure.mosaic)


def interpolated(signal: NDArray[np.float32], mosaic: str) -> NDArray[np.float32]:
    """(height, width, 3) bilinear interpolation of a mosaic, mirrored at its edges."""
    import cv2

    height, width = signal.shape
    values = np.empty((height, width, 3), np.float32)
    for channel, colour in enumerate("RGB"):
        plane = np.zeros_like(signal)
        for place, name in enumerate(mosaic):
            if name == colour:
                part = np.s_[place // 2 :: 2, place % 2 :: 2]
                plane[part] = signal[part]
        kernel = BILINEAR[colour].astype(np.float32)
        values[..., channel] = cv2.filter2D(plane, -1, kernel, borderType=cv2.BORDER_REFLECT_101)
    return values


def spoilt_by(spoilt: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """What a spoilt sample spoils by bilinear interpolation: its eight neighbours."""
    import cv2

    return np.asarray(cv2.dilate(spoilt.astype(np.uint8), np.ones((3, 3), np.uint8))) > 0


def _middle_of(shape: tuple[int, ...]) -> tuple[slice, slice]:
    """Rows and columns of the middle of a picture, a square of NOISE_SIDE at most, at an even place."""
    top, left = (max((size - NOISE_SIDE) // 4, 0) * 2 for size in shape[:2])
    return np.s_[top : top + NOISE_SIDE, left : left + NOISE_SIDE]


def _middle(exposure: Exposure) -> Exposure:
    """The middle of an exposure."""
    place = _middle_of(exposure.signal.shape)
    parts: dict[str, Any] = {
        name: part[place]
        for name in ("signal", "full", "rounding", "curve")
        if isinstance(part := getattr(exposure, name), np.ndarray)
    }
    return replace(exposure, **parts)
