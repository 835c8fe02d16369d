"""Shown: linear pictures as display values: sRGB, Display P3, or a view of ACES by OpenColorIO.

Views are those of OpenColorIO's own configuration of ACES 2.0, on the displays whose profile the file can state.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.icc import DISPLAY_P3, SRGB, icc_profile, xyz_from_display
from hagoromo.files.png import write_png
from hagoromo.files.reading import library
from hagoromo.files.tiff import write_tiff
from hagoromo.light.colour import srgb_encode

CONFIGURATION = "ocio://studio-config-v4.0.0_aces-v2.0_ocio-v2.5"
LINEAR = "Linear Rec.709 (sRGB)"  # as that configuration calls linear sRGB
OCIO_DISPLAYS = {"sRGB - Display": SRGB, "Display P3 - Display": DISPLAY_P3}


class DisplayTransform:
    """A way to show linear pictures. name: sRGB, Display P3, or a view such as "ACES 2.0 - SDR 100 nits (Rec.709)".

    profile: the display whose values they are. `InputError` for another name, which lists those there are.
    """

    def __init__(self, name: str | None = None) -> None:
        self.name = name or SRGB
        self.view: Any = None
        self.profile = self.name
        if self.name not in (SRGB, DISPLAY_P3):
            self.profile, self.view = _view(self.name)

    def values(self, linear: NDArray[Any]) -> NDArray[np.float64]:
        """Display values 0…1 of linear sRGB (height, width, 3)."""
        rgb = np.nan_to_num(np.asarray(linear, np.float64))
        if self.view is not None:
            shown = np.ascontiguousarray(rgb, np.float32)
            self.view.applyRGB(shown)
            return np.clip(shown.astype(np.float64), 0.0, 1.0)
        if self.profile != SRGB:
            rgb = rgb @ np.linalg.solve(xyz_from_display(self.profile), xyz_from_display(SRGB)).T
        return srgb_values(rgb)

    def save(self, path: str | Path, values: NDArray[np.float64], deep: bool = False) -> None:
        """Write display values as PNG, or TIFF by the suffix, with the profile; deep: 16 bits in place of 8."""
        kind = np.dtype(np.uint16 if deep else np.uint8)
        numbers: Any = np.round(np.iinfo(kind).max * np.clip(values, 0.0, 1.0)).astype(kind)
        numbers = numbers[..., 0] if numbers.shape[2] == 1 else numbers
        if Path(path).suffix.lower() in (".tif", ".tiff"):
            write_tiff(path, numbers, icc_profile(self.profile) if numbers.ndim == 3 else None)
        else:
            self.save_png(path, numbers)

    def save_png(self, path: str | Path, numbers: NDArray[Any]) -> None:
        """Write whole numbers as PNG; sRGB has a chunk of its own there, other displays their ICC profile."""
        if self.profile == SRGB:
            write_png(path, numbers, srgb=True)
        else:
            write_png(path, numbers, profile=icc_profile(self.profile))

    def numbers(self, linear: NDArray[Any]) -> NDArray[np.uint8]:
        """8-bit display values of linear sRGB."""
        if self.name == SRGB:
            return srgb_encode(linear)
        return np.round(255.0 * self.values(linear)).astype(np.uint8)


def _view(name: str) -> tuple[str, Any]:
    """The display of a view, and what computes its values."""
    ocio = library("PyOpenColorIO")
    configuration = ocio.Config.CreateFromFile(CONFIGURATION)
    views = {view: display for display in OCIO_DISPLAYS for view in configuration.getViews(display) if view != "Raw"}
    views |= {view: "sRGB - Display" for view in configuration.getViews("sRGB - Display") if view in views}
    if name not in views:
        raise InputError(f"there is no display {name!r:.80}: give one of {', '.join((SRGB, DISPLAY_P3, *views))}")
    display = views[name]
    transform = ocio.DisplayViewTransform(src=LINEAR, display=display, view=name)
    return OCIO_DISPLAYS[display], configuration.getProcessor(transform).getDefaultCPUProcessor()


def srgb_values(linear: NDArray[np.float64]) -> NDArray[np.float64]:
    """Display values 0…1 of linear ones (IEC 61966-2-1)."""
    cut = np.clip(linear, 0.0, 1.0)
    return np.where(cut <= 0.0031308, 12.92 * cut, 1.055 * cut ** (1 / 2.4) - 0.055)
