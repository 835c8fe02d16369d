"""Any picture: PNG, JPEG, TIFF, EXR (spectral ones, too) or HDR, as linear or as display values; written as another.

Linear pictures are linear sRGB. Display values are sRGB's, in 0…1 of their 8 or 16 bits.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.checks import existing_file
from hagoromo.files.exr import read_exr, write_exr
from hagoromo.files.hdr import read_hdr, write_hdr
from hagoromo.files.icc import linear_by_profile
from hagoromo.files.picture import read_picture
from hagoromo.files.tiff import read_tiff
from hagoromo.files.whole import replaceable_file
from hagoromo.image.picture.shown import DisplayTransform, srgb_values
from hagoromo.image.picture.spectral_exr import is_spectral, spectral_of_channels
from hagoromo.light.colour import srgb_decode

RGB = ("R", "G", "B")
LINEAR = (".exr", ".hdr")
DISPLAYED = (".png", ".tif", ".tiff")


class AnyPicture(NamedTuple):
    """values: (height, width, 1 or 3), linear or, where `displayed`, display values in 0…1."""

    name: str
    values: NDArray[np.float64]
    displayed: bool

    @property
    def linear(self) -> NDArray[np.float64]:
        """Linear values; of display values 1 is the display's white."""
        return srgb_decode(255.0 * self.values) if self.displayed else self.values


def read_any_picture(path: str | Path) -> AnyPicture:
    """The picture at `path`; of an EXR its R, G and B, its only channel, or the colours of its spectra.

    Display values of another colour space than sRGB become sRGB's by the profile in the file, cut off at its gamut.

    `InputError` for another format, a damaged file, and channels that are no picture.
    """
    suffix = existing_file(path).suffix.lower()
    if suffix == ".hdr":
        return AnyPicture(str(path), read_hdr(path).astype(np.float64), False)
    if suffix != ".exr":
        image = read_tiff(path) if suffix in DISPLAYED[1:] else read_picture(path)
        picture = picture_of(str(path), image)
        linear = linear_by_profile(path, picture.values) if picture.displayed else None
        return picture if linear is None else picture._replace(values=srgb_values(linear))
    layers, _ = read_exr(path)
    if not set(RGB) <= set(layers) and is_spectral(layers):
        return AnyPicture(str(path), spectral_of_channels(layers, str(path)).linear_srgb(), False)
    names = RGB if set(RGB) <= set(layers) else tuple(layers)
    if len(names) not in (1, 3):
        raise InputError(
            f"{path} has the channels {', '.join(layers)}: give an EXR with R, G and B, or with one channel"
        )
    return picture_of(str(path), np.stack([layers[name] for name in names], axis=2))


def picture_of(name: str, image: NDArray) -> AnyPicture:
    """An array as a picture: whole numbers are display values, of which alpha is dropped."""
    if image.ndim not in (2, 3):
        raise InputError(f"{name} has the shape {image.shape}: give (height, width) or (height, width, channels)")
    displayed = image.dtype.kind in "ui"
    values = image.astype(np.float64) / (np.iinfo(image.dtype).max if displayed else 1.0)
    values = values[..., None] if values.ndim == 2 else values[..., :3]
    if values.shape[2] not in (1, 3):
        raise InputError(f"{name} has {values.shape[2]} channels: give one or three")
    return AnyPicture(name, values, displayed)


def convert_picture(
    source: str | Path, out: str | Path, peak: float | None = None, force: bool = False, display: str | None = None
) -> None:
    """Write a picture as linear .exr or .hdr, or for the display as .png (8 bits) or .tif (16).

    peak: linear value that the display shows white (default: 1); what is brighter is cut off, or as the view of ACES
    has it. display: see `DisplayTransform` (default: sRGB).
    """
    out, suffix = Path(out), Path(out).suffix.lower()
    if suffix not in LINEAR + DISPLAYED:
        raise InputError(
            f"{source} is a picture, which is written as {', '.join(LINEAR + DISPLAYED)}: given {out.name}"
        )
    if peak is not None and not 0.0 < peak < np.inf:
        raise InputError(f"the peak is {peak}: give a number above 0, the linear value that is white")
    if display is not None and suffix in LINEAR:
        raise InputError(f"{out.name} is linear, without a display (--display): leave it out, or write PNG or TIFF")
    replaceable_file(out, force)
    shown, picture = DisplayTransform(display), read_any_picture(source)
    if suffix in LINEAR:
        linear = _three(picture.linear).astype(np.float32)
        if suffix == ".hdr":
            write_hdr(out, linear)
        else:
            write_exr(out, {name: linear[..., k] for k, name in enumerate(RGB)}, {"colour_space": "linear sRGB"})
        return
    if picture.displayed and display is None:
        values = picture.values
    elif display is None:
        values = shown.values(picture.values / (peak or 1.0))
    else:
        values = shown.values(_three(picture.linear) / (peak or 1.0))
    shown.save(out, values, deep=suffix != ".png")


def _three(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Three channels, of a grey picture three alike."""
    return np.broadcast_to(values, (*values.shape[:2], 3))
