"""A raw sensor with the faults of real ones, simulated apart from the package: narrow-band lamps, crosstalk, blooming.

Nothing of `hagoromo` makes the numbers. The faults are those of a real set of seven narrow-band lamps at seven
exposures: two greens that differ, a black level that the camera over-subtracts, full wells that flood their neighbours,
and frames with next to no light.
"""

from typing import NamedTuple

import numpy as np
from scipy.ndimage import convolve, gaussian_filter

from hagoromo.files.exif import Exif
from hagoromo.photograph.development.exposure import Exposure

HEIGHT, WIDTH = 142, 178
TIMES = tuple(0.004 * 2.0**k for k in range(7))  # s
BLACK, BITS = 128.0, 12  # as the file states the black level [DN]
SEVERAL_GREENS = (1.0, 0.40, 0.16, 0.06)  # light of R, G, G, B under a red lamp: the greens differ 2.5-fold


class RawSensor(NamedTuple):
    """gain [e⁻/DN]; read_noise [e⁻]; full_well [e⁻]; over: DN that the stated black is above the true one; bloom: share
    of the charge above the full well that reaches each of the four neighbours, and on.
    """

    gain: float = 23.5
    read_noise: float = 18.0
    full_well: float = 80_000.0
    over: float = 0.0
    bloom: float = 0.1


USUAL = RawSensor()


def object_light(seed: int, contrast: float = 1.0) -> np.ndarray:
    """(HEIGHT, WIDTH) of mean about 1: broad shading, fine texture through a lens of 1.3 px, and a lamp's glint."""
    random = np.random.default_rng(seed)
    broad = 18.0 * gaussian_filter(random.normal(size=(HEIGHT, WIDTH)), 9)
    fine = 0.8 * gaussian_filter(random.normal(size=(HEIGHT, WIDTH)), 1.3)
    light = np.exp(contrast * (broad + fine))
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    for row, column in random.uniform(20, 120, (4, 2)):
        light += 60.0 * contrast * np.exp(-0.5 * ((rows - row) ** 2 + (columns - column) ** 2) / 2.0**2)
    return light


def raw_numbers(
    light: np.ndarray, seconds: float, sensor: RawSensor, seed: int, bands: tuple[float, ...] = SEVERAL_GREENS
) -> np.ndarray:
    """Numbers (HEIGHT, WIDTH) of an RGGB mosaic: photons, flooding, read noise, gain, black level and whole numbers."""
    random = np.random.default_rng(seed)
    share = np.tile(np.reshape(bands, (2, 2)), (HEIGHT // 2 + 1, WIDTH // 2 + 1))[:HEIGHT, :WIDTH]
    charge = random.poisson(light * share * seconds).astype(float)
    spill = sensor.bloom * np.array([[0, 1, 0], [1, 0, 1], [0, 1, 0]], float)
    for _ in range(3):
        above = np.maximum(charge - sensor.full_well, 0.0)
        charge = np.minimum(charge, sensor.full_well) + convolve(above, spill, mode="constant")
    charge = np.minimum(charge, sensor.full_well) + random.normal(0.0, sensor.read_noise, charge.shape)
    return np.clip(np.rint(charge / sensor.gain + BLACK - sensor.over), 0, 2**BITS - 1)


def raw_exposure(numbers: np.ndarray, seconds: float, sensor: RawSensor, mosaic: str = "RGGB") -> Exposure:
    """The exposure as the file states it: black 128 DN, white a little below the full well."""
    full = np.floor(
        BLACK - sensor.over + sensor.full_well / sensor.gain - 5.0 * (1.0 + sensor.read_noise / sensor.gain)
    )
    signal = (numbers - BLACK).astype(np.float32)
    exif = Exif(exposure_s=seconds, iso=100.0)
    return Exposure(signal, 1.0 / 12.0, numbers >= full, float(full - BLACK), mosaic, exif, f"{seconds:g} s")


def raw_bracket(
    seed: int,
    sensor: RawSensor = USUAL,
    bands: tuple[float, ...] = SEVERAL_GREENS,
    level: float = 1.0,
    overs: tuple[float, ...] = (),
) -> list[Exposure]:
    """Seven exposures of one object; level: light relative to one that fills the longest exposure to a third.

    overs: what the black of each frame is above the true one, in place of that of the sensor, and as many exposures.
    """
    light = object_light(seed) * level * sensor.full_well / 3.0 / TIMES[-1] / max(bands)
    found = []
    for i, t in enumerate(TIMES[: len(overs) or None]):
        own = sensor._replace(over=overs[i]) if overs else sensor
        found.append(raw_exposure(raw_numbers(light, t, own, 100 * seed + i, bands), t, own))
    return found
