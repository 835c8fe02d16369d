"""Pixels of an image file: sensor numbers (RAW, PNG, TIFF, JPEG) or linear values (EXR) ↔ values with variance.

Points of the pixels of a picture as EXR: channels P.X, P.Y, P.Z in single precision [m], world, 0 where unknown.

Single precision keeps 1 mm at 10 km. So points that lie far out are counted from a place beside them, which the text
`points_origin` in the header of the file states, as three numbers [m].
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.sensor import Demosaic, Sensor, develop_raw, native_channels
from hagoromo.errors import InputError
from hagoromo.files.exr import read_exr, write_exr
from hagoromo.files.jpeg import read_jpeg
from hagoromo.files.png import read_png, write_png
from hagoromo.files.raw import RAW_SUFFIXES
from hagoromo.files.tiff import read_tiff
from hagoromo.light.colour import srgb_decode
from hagoromo.photograph.development.exposure import StatedExposure, read_exposure
from hagoromo.photograph.photograph import Photograph
from hagoromo.photograph.transforms import ASSUMED_FULL_WELL, ASSUMED_READ_NOISE, ImageSettings, sensor_from_record
from hagoromo.photograph.variance_model import VarianceModel

READERS = {".png": read_png, ".jpg": read_jpeg, ".jpeg": read_jpeg, ".tif": read_tiff, ".tiff": read_tiff}
SUFFIXES = (*READERS, ".exr", *RAW_SUFFIXES)
VARIANCE, NATIVE, ALPHA = "variance.", "native.", "A"  # EXR channels beside those of the values
VALID = "valid."  # EXR channels of where each colour is valid; A is where all are


LARGEST_VALUE = 1e15  # whose square, over a full well, is a number in single precision
CHANNELS = ("P.X", "P.Y", "P.Z")
ORIGIN = "points_origin"  # key of the header
FAR = 16.0  # sizes of the surface, from which on its points are counted from a place beside it


class DevelopedPixels(NamedTuple):
    """values, variance, native: as `Photograph`; valid (height, width); sensor: None if its parameters are assumed.

    opaque: (height, width), None where the file has no transparency.
    """

    values: NDArray[np.float32]
    variance: NDArray[np.float32]
    valid: NDArray[np.bool_]
    native: NDArray[np.bool_] | None
    sensor: Sensor | None
    opaque: NDArray[np.bool_] | None = None


def read_pixels(
    path: Path, frame: ImageSettings, channels: Sequence[str], demosaic: Demosaic, where: str
) -> DevelopedPixels:
    """Pixels of the image at `path`.

    frame: its `sensor`, `transfer`, `exposure_s` and `iso` (None: as a RAW file states, else 1 s and 100). channels:
    names of the EXR channels in the order of the values.
    `InputError` for a file that is not an image, or contradicts the sensor.
    """
    if path.suffix.lower() in RAW_SUFFIXES:
        return _from_raw(path, frame, demosaic, where)
    seconds, iso = frame.exposure_s or 1.0, frame.iso or 100.0
    reader = READERS.get(path.suffix.lower())
    image = None if reader is None else reader(path)
    if image is not None and image.dtype.kind == "f":
        raise InputError(f"{path} holds floating-point values: convert it to EXR with `develop` first")
    depth = 16 if image is None else 8 * image.dtype.itemsize
    sensor = sensor_from_record(frame.sensor, depth, seconds, iso, where)
    known = sensor if any(k != "response" for k in frame.sensor) and frame.transfer == "linear" else None
    if image is None:
        return _from_exr(path, channels, seconds * iso / 100.0, frame.variance_model, where)._replace(sensor=known)
    numbers, opaque = _opaque(image)
    if sensor.largest < numbers.max(initial=0):
        raise InputError(
            f"{path} holds {numbers.max()}, more than {sensor.bits} bits allow: correct the sensor's `bits`"
        )
    mosaic = sensor.mosaic if numbers.ndim == 2 else ""
    raw = numbers if mosaic or numbers.ndim == 3 else numbers[..., None]
    if frame.transfer == "srgb":
        values, variance, valid = _from_srgb(raw, sensor)
    else:
        values, variance, valid = develop_raw(raw, replace(sensor, mosaic=mosaic), demosaic)
    native = native_channels(sensor, *numbers.shape[:2]) if mosaic else None
    return DevelopedPixels(values, variance, valid & opaque, native, known, None if opaque.all() else opaque)


def read_mask(path: Path, shape: tuple[int, int]) -> NDArray[np.bool_]:
    """True where the PNG at `path` is neither black nor transparent; `InputError` if it does not have `shape`."""
    mask, opaque = _opaque(read_png(path))
    if mask.shape[:2] != shape:
        raise InputError(f"{path} has shape {mask.shape[:2]} and its photograph {shape}: resize the mask")
    return opaque & (mask.reshape(*shape, -1) > 0).any(axis=2)


def write_pixels(photograph: Photograph, stem: Path) -> Path:
    """Write the photograph as `stem`.png if sensor numbers represent it exactly, else as EXR; returns the path."""
    numbers = _sensor_numbers(photograph)
    if numbers is not None:
        write_png(stem.with_suffix(".png"), numbers)
        return stem.with_suffix(".png")
    count = photograph.values.shape[2]
    response = photograph.camera.response
    names = response.channels if response and len(response.channels) == count else default_channels(count)
    used, light = photograph.mask[..., None], {"": photograph.values, VARIANCE: photograph.variance}
    layers = {prefix: np.where(used | np.isfinite(layer), layer, 0.0) for prefix, layer in light.items()}
    if photograph.native is not None:
        layers[NATIVE] = photograph.native.astype(np.float32)
    valid = {} if photograph.silhouette is None else {ALPHA: photograph.mask.astype(np.float32)}
    channels = {prefix + name: layer[..., i] for prefix, layer in layers.items() for i, name in enumerate(names)}
    write_exr(stem.with_suffix(".exr"), channels | valid, {"colourSpace": "camera, linear, in units of ρ of eq. (10)"})
    return stem.with_suffix(".exr")


def default_channels(count: int) -> tuple[str, ...]:
    """Default names of `count` channels."""
    return {1: ("Y",), 3: ("R", "G", "B")}.get(count, tuple(f"band{i:03d}" for i in range(count)))


def _from_raw(path: Path, frame: ImageSettings, demosaic: Demosaic, where: str) -> DevelopedPixels:
    """Camera RAW, with the file's levels, mosaic and exposure unless the frame states others."""
    sensor_keys = frame.sensor
    settings = StatedExposure(
        sensor_keys.get("black_level"), sensor_keys.get("white_level"), None, None, frame.exposure_s, frame.iso
    )
    shot = read_exposure(path, settings)
    levels = {"black_level": 0.0, "white_level": shot.white, "bits": 16, "mosaic": shot.mosaic}
    sensor = sensor_from_record({**sensor_keys, **levels}, 16, shot.seconds, shot.iso, where)
    values, variance, valid = develop_raw(shot.signal, sensor, demosaic)
    native = native_channels(sensor, *shot.signal.shape[:2])
    known = sensor if {"gain", "read_noise"} <= set(sensor_keys) else None
    return DevelopedPixels(values, variance, valid, native, known)


def _from_exr(
    path: Path, channels: Sequence[str], scale: float, model: Mapping[str, Any] | None, where: str
) -> DevelopedPixels:
    layers, _ = read_exr(path)
    names = [name for name in layers if not name.startswith((VARIANCE, NATIVE, VALID)) and name != ALPHA]
    for order in (tuple(channels), default_channels(len(names))):
        names = list(order) if set(order) == set(names) else names
    if not names:
        raise InputError(f"{path} has no channel of values: give one such as Y, or R, G and B")
    values = np.stack([layers[name] for name in names], axis=2)
    finite = np.isfinite(values).all(axis=2)
    if np.abs(values[finite]).max(initial=0.0) > LARGEST_VALUE:
        raise InputError(f"{path} has values above {LARGEST_VALUE:g}, whose variances are no numbers: scale them down")
    native = None
    if model is not None:
        curve = VarianceModel.from_record(model, where)
        variance = curve.of(np.where(np.isfinite(values), values, np.float32(0.0)))
        native = curve.native(*values.shape[:2])
    elif all(VARIANCE + name in layers for name in names):
        variance = np.stack([layers[VARIANCE + name] for name in names], axis=2)
    else:
        electron = max(float(values[finite].max(initial=0.0)), 1e-30) / ASSUMED_FULL_WELL
        variance = electron**2 * (np.maximum(values / electron, 0.0) + 1.0 + ASSUMED_READ_NOISE**2)
    if native is None and all(NATIVE + name in layers for name in names):
        native = np.stack([layers[NATIVE + name] > 0.5 for name in names], axis=2)
    valid = np.asarray(finite & np.isfinite(variance).all(axis=2), np.bool_)
    if ALPHA in layers:
        valid &= layers[ALPHA] == 1.0
    return DevelopedPixels(
        values / np.float32(scale), np.asarray(variance / np.float32(scale**2), np.float32), valid, native, None
    )


def _opaque(image: NDArray) -> tuple[NDArray, NDArray[np.bool_]]:
    """The image without alpha, and where alpha is full: a partly transparent pixel also shows the background."""
    if image.ndim == 2 or image.shape[2] == 3:
        return image, np.ones(image.shape[:2], np.bool_)
    return image[..., :3], image[..., 3] == np.iinfo(image.dtype).max


def _from_srgb(numbers: NDArray, sensor: Sensor) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_]]:
    """Linear values of sRGB numbers; their quantisation step is larger in bright than in dark regions."""
    bounds = np.arange(sensor.largest + 2.0) - 0.5
    light = sensor.largest * srgb_decode(255.0 * np.clip(bounds, 0.0, sensor.largest) / sensor.largest)
    centre = sensor.largest * srgb_decode(255.0 * (bounds[:-1] + 0.5) / sensor.largest)
    developed = develop_raw(centre[numbers], replace(sensor, mosaic=""))
    # develop_raw has assumed the rounding variance of linear numbers, 1/12
    rounding = (np.diff(light)[numbers] ** 2 - 1.0) / 12.0 * (sensor.gain / sensor.exposure) ** 2
    return developed.values, (developed.variance + rounding).astype(np.float32), developed.valid


def _sensor_numbers(photograph: Photograph) -> NDArray | None:
    """Sensor numbers from which `develop_raw` makes exactly this photograph; None if there are none."""
    sensor, native = photograph.camera.sensor, photograph.native
    height, width, count = photograph.values.shape
    if sensor is None or count not in (1, 3):
        return None
    numbers = np.rint(photograph.values.astype(np.float64) * sensor.exposure / sensor.gain + sensor.black_level)
    if not ((numbers >= 0) & (numbers <= sensor.largest))[True if native is None else native].all():
        return None
    if native is None:
        sensor = replace(sensor, mosaic="")
    elif sensor.mosaic and (native == native_channels(sensor, height, width)).all():
        numbers = np.where(native, numbers, 0.0).sum(axis=2)
    else:
        return None
    again = develop_raw(numbers, sensor)
    if (photograph.mask & ~again.valid).any():
        return None
    for mine, theirs in ((photograph.values, again.values), (photograph.variance, again.variance)):
        if not np.allclose(mine, theirs, rtol=1e-5, atol=1e-5 * float(theirs.max())):
            return None
    depth = np.uint8 if sensor.bits <= 8 else np.uint16
    return (numbers[..., 0] if count == 1 and numbers.ndim == 3 else numbers).astype(depth)


def write_points(path: str | Path, points: NDArray[np.floating]) -> None:
    """Write `points` (height, width, 3) [m], 0 or not finite where unknown."""
    known = _known(points)
    origin = _beside(points[known].astype(np.float64)) if known.any() else np.zeros(3)
    counted = np.where(known[..., None], points - origin, 0.0)
    header = {ORIGIN: " ".join(map(repr, origin.tolist()))} if origin.any() else None
    write_exr(path, dict(zip(CHANNELS, np.moveaxis(counted, 2, 0), strict=True)), header)


def read_points(path: str | Path) -> NDArray[np.floating]:
    """Points (height, width, 3) [m]; in double precision where the file states an origin. `InputError` if damaged."""
    layers, header = read_exr(path)
    lacking = [name for name in CHANNELS if name not in layers]
    if lacking:
        raise InputError(f"{path} lacks the channel {lacking[0]}: points have {', '.join(CHANNELS)}")
    points = np.stack([layers[name] for name in CHANNELS], axis=2)
    if ORIGIN not in header:
        return points
    origin = _numbers(header[ORIGIN])
    if origin is None:
        raise InputError(f"{path}: {ORIGIN} is {header[ORIGIN]!r:.60}: give three finite numbers [m]")
    known = _known(points)
    placed = np.zeros(points.shape)
    placed[known] = points[known] + origin
    return placed


def _known(points: NDArray[np.floating]) -> NDArray[np.bool_]:
    return np.isfinite(points).all(axis=2) & (points != 0.0).any(axis=2)


def _beside(places: NDArray[np.float64]) -> NDArray[np.float64]:
    """A place one size beside `places` (n, 3), so that none of them is 0 seen from it; 0 where they are not far out."""
    low, size = places.min(axis=0), float(np.linalg.norm(np.ptp(places, axis=0)))
    return low - size if np.abs(places).max() > FAR * size > 0.0 else np.zeros(3)


def _numbers(text: str) -> NDArray[np.float64] | None:
    """Three finite numbers; None for anything else."""
    try:
        numbers = np.array([float(word) for word in text.split()])
    except ValueError:
        return None
    return numbers if numbers.shape == (3,) and np.isfinite(numbers).all() else None
