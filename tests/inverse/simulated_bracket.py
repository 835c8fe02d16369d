"""Simulated exposures of a known scene by a known sensor, and a minimal DNG of one."""

from pathlib import Path

import numpy as np
import tifffile
from scipy.ndimage import gaussian_filter, shift

from hagoromo.camera.sensor import Sensor, expose_raw
from hagoromo.files.exif import Exif
from hagoromo.photograph.development.exposure import Exposure

SENSOR = Sensor(exposure=1.0, full_well=30_000.0, read_noise=6.0, gain=2.1, black_level=512.0, bits=14, mosaic="RGGB")
WHITE = 2**14 - 1  # DN; the well is full at 512 + 30 000 / 2.1 = 14 797 DN
FULL = SENSOR.white_level - 20.0  # DN: from here a sample may be full (4 read noises are 11 DN)
HEIGHT, WIDTH = 181, 227


def scene(seed: int = 1, moved: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
    """(HEIGHT, WIDTH, 3) electrons a second: texture over a range of 1 : 50 000; moved: by (x, y) px."""
    random = np.random.default_rng(seed)
    broad = gaussian_filter(random.normal(size=(HEIGHT, WIDTH)), 6)
    fine = gaussian_filter(random.normal(size=(HEIGHT, WIDTH)), 1.6)
    log = 36.0 * broad + 1.5 * fine
    if any(moved):
        log = shift(log, moved[::-1], order=5, mode="nearest")
    return 3000.0 * np.exp(log)[..., None] * (0.6, 1.0, 0.5)


def numbers(light: np.ndarray, seconds: float, seed: int, sensor: Sensor = SENSOR) -> np.ndarray:
    return expose_raw(light * seconds, sensor, seed)


def shot(light: np.ndarray, seconds: float, seed: int, sensor: Sensor = SENSOR, offset: np.ndarray | float = 0.0):
    """The exposure as `read_exposure` would give it; offset: dark signal [DN] on top."""
    raw = numbers(light, seconds, seed, sensor) + np.rint(offset)
    signal = (raw - sensor.black_level).astype(np.float32)
    exif = Exif(exposure_s=seconds, iso=100.0)
    white = FULL - sensor.black_level
    return Exposure(signal, 1.0 / 12.0, raw >= FULL, white, sensor.mosaic, exif, f"{seconds:g} s #{seed}")


def write_dng(path: Path, raw: np.ndarray, seconds: float = 0.02, black: int = 512, white: int = int(FULL)) -> None:
    """An uncompressed DNG of an RGGB mosaic at ISO 100, f/5.6, 55 mm on a 22.7 mm wide sensor."""
    dots = raw.shape[1] / 22.7  # px per mm

    def fraction(value: float) -> tuple[int, int]:
        return round(value * 1_000_000), 1_000_000

    identity = tuple(figure for value in np.eye(3).ravel() for figure in (int(value), 1))
    tags = [
        (33421, "H", 2, (2, 2), True),  # CFARepeatPatternDim
        (33422, "B", 4, bytes((0, 1, 1, 2)), True),  # CFAPattern
        (50706, "B", 4, bytes((1, 4, 0, 0)), True),  # DNGVersion
        (50707, "B", 4, bytes((1, 1, 0, 0)), True),  # DNGBackwardVersion
        (271, "s", 0, "Maker", True),
        (272, "s", 0, "Maker One", True),
        (50708, "s", 0, "Maker One", True),  # UniqueCameraModel
        (50714, "H", 1, black, True),  # BlackLevel
        (50717, "H", 1, white, True),  # WhiteLevel
        (50721, "2i", 9, identity, True),  # ColorMatrix1
        (50728, "2I", 3, (1, 1) * 3, True),  # AsShotNeutral
        (33434, "2I", 1, fraction(seconds), True),  # ExposureTime
        (33437, "2I", 1, (56, 10), True),  # FNumber
        (34855, "H", 1, 100, True),  # ISOSpeedRatings
        (37386, "2I", 1, (55, 1), True),  # FocalLength
        (41486, "2I", 1, fraction(dots), True),  # FocalPlaneXResolution
        (41488, "H", 1, 4, True),  # FocalPlaneResolutionUnit: mm
        (40962, "I", 1, raw.shape[1], True),  # PixelXDimension
    ]
    tifffile.imwrite(path, raw, photometric=32803, extratags=tags, metadata=None, software="")
