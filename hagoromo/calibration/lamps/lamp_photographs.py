"""Photographs of a chrome ball or an object under one lamp each, read when they are asked for."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.picture import by_name, read_picture
from hagoromo.files.raw import RAW_SUFFIXES
from hagoromo.photograph.development.exposure import StatedExposure
from hagoromo.photograph.one_exposure import light_with_gaps, read_frame
from hagoromo.photograph.pixels import default_channels, read_pixels
from hagoromo.photograph.transforms import ImageSettings

Transfer8 = Literal["linear", "srgb"]  # of 8-bit files
PICTURES = (".png", ".jpg", ".jpeg", ".tif", ".tiff")


def lamp_photographs(
    photographs: Sequence[str | Path] | Mapping[str, NDArray], transfer: Transfer8 | None, linear: bool
) -> Mapping[str, NDArray]:
    """Files as `LampPhotographs`; arrays as they are."""
    if isinstance(photographs, Mapping):
        return photographs
    return LampPhotographs([Path(path) for path in photographs], transfer, linear)


class LampPhotographs(Mapping[str, NDArray]):
    """Name → stored pixels, or light with NaN where it is clipped: of EXR and RAW, and of all where `linear`.

    Each is read when it is asked for, so that one is in memory; names as `by_name`. `InputError` for 8 bits that are to
    be linear without a stated transfer.
    """

    def __init__(self, paths: Sequence[Path], transfer: Transfer8 | None, linear: bool) -> None:
        self.paths = by_name(paths)
        self.transfer: Transfer8 | None = transfer
        self.linear = linear

    def __getitem__(self, name: str) -> NDArray:
        path = self.paths[name]
        if path.suffix.lower() in PICTURES and not (self.linear and self.transfer):
            numbers = read_picture(path)
            if not self.linear:
                return numbers
            if numbers.dtype == np.uint8:
                raise InputError(
                    f"{path} has 8 bits, which are rarely linear, as are needed here: state transfer (--transfer)"
                )
        if path.suffix.lower() in RAW_SUFFIXES and not self.linear:  # directions need no unit, and no variance
            return light_with_gaps(read_frame(path, StatedExposure()).exposure)
        frame = ImageSettings(transfer=self.transfer or "linear")
        pixels = read_pixels(path, frame, default_channels(3), "bilinear", str(path))
        return np.where(pixels.valid[..., None], pixels.values, np.float32(np.nan))

    def __iter__(self) -> Iterator[str]:
        return iter(self.paths)

    def __len__(self) -> int:
        return len(self.paths)
