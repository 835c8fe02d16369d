"""Transfer curve of a session's 8-bit photographs: measured by a bracket, or chosen by the shading of the object.

A bracket measures the curve (Debevec and Malik 1997). Without one, linear and sRGB are tried: Lambert's law holds for
the values of one of them, at most. Where both or none agree with it the photographs do not determine the curve.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.picture import read_picture
from hagoromo.files.tiff import read_tiff
from hagoromo.light.colour import srgb_decode
from hagoromo.light.lamp import Lamp
from hagoromo.photograph.developing import ESTIMATE
from hagoromo.photograph.development.develop import estimated_from_files
from hagoromo.photograph.development.exposure import TIFFS
from hagoromo.photograph.development.transfer import Transfer
from hagoromo.photograph.exponent import Exponent, exponent_of
from hagoromo.photograph.object_mask import Thumbnails, object_mask
from hagoromo.photograph.pixels import READERS, read_mask

MOST_SAMPLES = 20_000  # pixels of each photograph in which the shading is looked at
CANDIDATES = ("linear", "srgb")
BRIGHT = 0.1  # of white: pixels that are darker under every lamp do not count
INSTEAD = "state it (--transfer), or give three exposures of one scene (--bracket)"


class Estimated(NamedTuple):
    """The curve, or its name, and how it was found."""

    transfer: str | Transfer
    said: str


class Shaded(NamedTuple):
    """What the shading needs: files, a lamp and the exposure (seconds times ISO/100) for each; where the object is.

    mask: PNG that is white on it; without one it is looked for where `auto`, else it fills the picture.
    """

    paths: Sequence[Path]
    lamps: Sequence[Lamp]
    exposures: Sequence[float]
    mask: Path | None
    auto: bool
    excluded: NDArray[np.bool_] | None


def estimated_transfer(shaded: Shaded, bracket: Sequence[Path], times: Sequence[float]) -> Estimated:
    """The transfer of the 8-bit files of a session; `InputError` where it is not determined, with the reason."""
    if bracket:
        curve = estimated_from_files(bracket, times)
        worst = 0.0 if curve.error is None else float(curve.error.max()) / (len(curve.table) - 1.0)
        said = (
            f"estimated from a bracket of {len(bracket)} exposures, standard error up to {100.0 * worst:.1f} % of white"
        )
        return Estimated(curve, said)
    tried = dict(zip(CANDIDATES, _exponents(shaded), strict=True))
    if any(one is None for one in tried.values()):
        raise InputError(
            "the photographs do not determine their transfer (that takes six far lamps and 60 lit pixels): " + INSTEAD
        )
    found = {name: one for name, one in tried.items() if one is not None}
    good = [name for name, one in found.items() if not one.bent and not one.uncertain]
    bad = [name for name, one in found.items() if one.bent]
    figures = (f"{name} {one.value:.2f} ± {one.value * one.standard_error:.2f}" for name, one in found.items())
    exponents = f"exponent, where 1 is right: {', '.join(figures)}"
    if len(good) != 1 or len(bad) != len(CANDIDATES) - 1:
        raise InputError(f"the photographs do not determine their transfer ({exponents}): {INSTEAD}")
    return Estimated(good[0], f"{good[0]}, chosen by the shading of the object ({exponents})")


def _exponents(shaded: Shaded) -> list[Exponent | None]:
    """The exponent of the values by each of the candidates; None where it is not determined."""
    if any(lamp.to_lamp is None for lamp in shaded.lamps):
        return [None] * len(CANDIDATES)
    mask, numbers = None, []
    for path in shaded.paths:
        picture = _read(path)
        if mask is None:
            mask = _on_object(shaded, picture.shape[:2])
        if mask.shape != picture.shape[:2]:
            raise InputError(f"{path} is {picture.shape[:2]} pixels and {shaded.paths[0].name} {mask.shape}")
        rows, columns = np.nonzero(mask)
        chosen = np.s_[:: max(-(-len(rows) // MOST_SAMPLES), 1)]
        numbers.append(picture[rows[chosen], columns[chosen]])
    every = np.stack(numbers)
    to_lamp = np.stack([np.asarray(lamp.to_lamp) for lamp in shaded.lamps])
    to_eye = np.array([0.0, 0.0, np.copysign(1.0, to_lamp[:, 2].mean())])  # lamps are on the camera's side
    pairs = zip(shaded.exposures, shaded.lamps, strict=True)
    scale = np.array([time * float(np.mean(lamp.intensity)) for time, lamp in pairs])
    clipped = (every == 255).any(axis=2)
    found = []
    for light, least in ((every / 255.0, BRIGHT), (srgb_decode(every.astype(np.float64)), BRIGHT**2.2)):
        bright = np.max(light.mean(axis=2), axis=0) > least
        values = np.where(clipped, np.nan, light.mean(axis=2)) / scale[:, None]
        found.append(exponent_of(values[:, bright], to_lamp, to_eye))
    return found


def _on_object(shaded: Shaded, shape: tuple[int, int]) -> NDArray[np.bool_]:
    """(height, width) where the object is known to be."""
    if shaded.auto:
        seen = Thumbnails()
        for path in shaded.paths:
            picture = _read(path)
            seen.add(picture.astype(np.float32), np.ones(picture.shape[:2], np.bool_))
        return object_mask(seen, shape, None, shaded.excluded).mask
    mask = np.ones(shape, np.bool_) if shaded.mask is None else read_mask(shaded.mask, shape)
    return mask if shaded.excluded is None else mask & ~shaded.excluded


def _read(path: Path) -> NDArray[np.uint8]:
    """(height, width, C) numbers of an 8-bit file."""
    if path.suffix.lower() not in READERS:
        raise InputError(f"{path} is no 8-bit picture, whose transfer could be estimated: omit transfer (--transfer)")
    picture = (read_tiff if path.suffix.lower() in TIFFS else read_picture)(path)
    if picture.dtype != np.uint8:
        raise InputError(f"{path} has more than 8 bits, which are taken for linear: omit transfer (--transfer)")
    return np.asarray(picture[..., None] if picture.ndim == 2 else picture[..., :3], np.uint8)


def needs_estimate(transfer: str | Path | Transfer | None) -> bool:
    """Whether the transfer is to be estimated."""
    return isinstance(transfer, str) and transfer == ESTIMATE
