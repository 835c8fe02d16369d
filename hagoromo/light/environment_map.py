"""Environment map: the values of a map of the sphere, checked, and from files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hagoromo.errors import InputError
from hagoromo.files.checks import existing_file
from hagoromo.files.exr import read_exr
from hagoromo.files.hdr import STARTS, read_hdr
from hagoromo.files.memory import require

BYTES_PER_PIXEL = 96.0  # of the tables by which a map is sampled


def read_map(path: str | Path) -> NDArray[np.float32]:
    """(height, width[, 3]) of a file."""
    with existing_file(path).open("rb") as file:
        start = file.read(max(map(len, STARTS)))
    if start.startswith(STARTS):
        return read_hdr(path)
    channels, _ = read_exr(path)
    if all(name in channels for name in "RGB"):
        return np.stack([channels[name] for name in "RGB"], axis=-1)
    if "Y" in channels:
        return channels["Y"]
    raise InputError(f"{path} has the channels {', '.join(channels)[:80]}: an environment has R, G and B, or Y")


def checked_map(values: ArrayLike, name: str) -> NDArray[np.float32]:
    """The map of an environment, read-only; name: in messages. `InputError` as of `Environment`."""
    try:
        given = np.asarray(values)
        shape = given.shape
    except (TypeError, ValueError) as error:
        raise InputError(f"{name}: the map must hold numbers") from error
    if len(shape) not in (2, 3) or shape[1] != 2 * shape[0] or shape[0] < 1 or shape[2:] not in ((), (3,)):
        size = " × ".join(str(side) for side in (*shape[1::-1], *shape[2:]))
        raise InputError(f"{name} is {size}: give a map twice as wide as high, of one number or R, G, B a pixel")
    require(BYTES_PER_PIXEL * shape[0] * shape[1], f"{name}, a map of {shape[1]} × {shape[0]} pixels,")
    with np.errstate(over="ignore"):
        try:
            light = np.array(given, np.float32)
        except (TypeError, ValueError) as error:
            raise InputError(f"{name}: the map must hold numbers") from error
    for wrong, what in ((~np.isfinite(light), "that is not finite"), (light < 0.0, "below 0")):
        if wrong.any():
            row, column = np.argwhere(wrong)[0][:2]
            raise InputError(
                f"{name} has light {what} in {int(wrong.sum())} values, first in row {row}, column {column}: correct it"
            )
    if not light.any():
        raise InputError(f"{name} has no light in any pixel: give a map that has some, or leave it out")
    light.flags.writeable = False
    return light
