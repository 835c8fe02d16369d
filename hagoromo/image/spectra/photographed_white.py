"""What a perfect white would read in a photograph, from a chart of 24 patches or a white patch in it.

Enters: a linear photograph and the spectra of camera, lamp and patches. Leaves: the reading per channel, and how well
the chart's patches agree with it: that error every other reading is given, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hagoromo.calibration.response.chart import read_chart
from hagoromo.camera.response import Response
from hagoromo.errors import InputError
from hagoromo.files.exr import read_exr
from hagoromo.files.picture import read_picture
from hagoromo.files.raw import RAW_SUFFIXES
from hagoromo.least_squares.loss import ROBUST_SCALE
from hagoromo.light.spectrum import Spectrum
from hagoromo.reflectance.spectra.prior_spectra import WAVELENGTHS
from hagoromo.reflectance.spectra.spectrum_estimate import reading_matrix

FEWEST_PATCHES = 6
Array = NDArray[Any]


class White(NamedTuple):
    """reading: (channels,) of a perfect white. scatter: (channels,) relative error of a reading, from the chart."""

    reading: Array
    scatter: Array


def read_linear(path: str | Path) -> NDArray:
    """(h, w, channels) linear values of a developed EXR, NaN where invalid, or of a 16-bit PNG or TIFF.

    `InputError` for RAW files and for 8 bits, whose transfer curve is not known here: develop them first.
    """
    if Path(path).suffix.lower() in RAW_SUFFIXES:
        raise InputError(f"{path} is a RAW file: develop it first, `hagoromo develop {Path(path).name} --out NAME.exr`")
    if Path(path).suffix.lower() != ".exr":
        picture = read_picture(path)
        if picture.dtype == np.uint8 or picture.ndim != 3:
            raise InputError(f"{path} has 8 bits or one channel: give a developed EXR, or 16 bits and three channels")
        values = picture[..., :3].astype(np.float64)
        return np.where((picture[..., :3] == np.iinfo(picture.dtype).max).any(axis=2)[..., None], np.nan, values)
    channels, _ = read_exr(path)
    missing = [name for name in "RGB" if name not in channels]
    if missing:
        raise InputError(f"{path} has no channel {', '.join(missing)}: give a developed photograph")
    values = np.stack([channels[name] for name in "RGB"], axis=2)
    return np.where(channels["A"][..., None] > 0.0, values, np.nan) if "A" in channels else values


def white_from_chart(
    photograph: NDArray, lamp: Spectrum, response: Response, chart: Sequence[Spectrum], corners: ArrayLike | None = None
) -> White:
    """The white of the photograph in which, or beside which, the chart was photographed."""
    surfaces = np.array([patch.held(360.0, 830.0).at(WAVELENGTHS) for patch in chart])
    expected = surfaces @ reading_matrix(lamp, response).T
    reading = read_chart(photograph, expected, corners)
    usable = np.isfinite(reading.values).all(axis=1)
    if usable.sum() < FEWEST_PATCHES:
        raise InputError(f"{int(usable.sum())} patches of the chart are neither clipped nor invalid: expose less")
    values, expected = reading.values[usable], expected[usable]
    ratio = values / expected
    white = np.exp(np.median(np.log(np.maximum(ratio, 1e-12)), axis=0))
    scatter = ROBUST_SCALE * np.median(np.abs(ratio / white - 1.0), axis=0)
    return White(white, scatter)


def white_from_patch(values: Array, reflectance: float) -> White:
    """The white of a photograph in which a patch of known, neutral `reflectance` reads `values` (channels,)."""
    if not 0.0 < reflectance <= 1.2:
        raise InputError(f"the white patch has reflectance {reflectance:g}: give a number above 0, such as 0.99")
    return White(values / reflectance, np.zeros_like(values))
