"""Shown: linear pictures as display values: sRGB, Display P3, or a view of OpenColorIO.

Views that are named alone are those of OpenColorIO's own configuration of ACES 2.0, on the displays whose profile the
file can state.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.icc import DISPLAY_P3, SRGB, icc_profile, xyz_from_display
from hagoromo.files.png import png_bytes, write_png
from hagoromo.files.tiff import write_tiff
from hagoromo.image.picture.ocio_view import ACES, PROFILES, OcioConfiguration
from hagoromo.light.colour import srgb_encode

MOST_STOPS = 32.0
NAMED = ("sRGB - Display", "Display P3 - Display")  # displays of ACES whose views are known by their names alone


@dataclass(frozen=True)
class DisplayView:
    """How a picture is shown to people; what is kept of it stays linear.

    display: sRGB (None), Display P3, the name of a view of ACES 2.0, or, with `view` or `ocio`, a display of that
    configuration. ocio: a file, or ocio://NAME; None: ACES 2.0. view: None: the display's own. exposure: stops above
    that which `Image.display` finds.
    """

    display: str | None = None
    view: str | None = None
    ocio: str | None = None
    exposure: float = 0.0

    def __post_init__(self) -> None:
        if not abs(self.exposure) <= MOST_STOPS:
            raise InputError(f"exposure is {self.exposure:g} stops: give −{MOST_STOPS:g} to {MOST_STOPS:g}")

    @property
    def factor(self) -> float:
        """On linear values."""
        return 2.0**self.exposure


class DisplayTransform:
    """A way to show linear pictures. name: sRGB, Display P3, or a view such as "ACES 2.0 - SDR 100 nits (Rec.709)"; or
    a `DisplayView`, whose exposure is left to others.

    profile: the display whose values they are; "" of one whose profile is not known. `InputError` for another name,
    which lists those there are.
    """

    def __init__(self, name: str | DisplayView | None = None) -> None:
        look = name if isinstance(name, DisplayView) else DisplayView(name)
        self.name = look.display or SRGB
        self.view: Any = None
        self.profile = self.name
        if look.view is not None or look.ocio is not None:
            configuration = OcioConfiguration(ACES if look.ocio is None else look.ocio)
            display, view = configuration.chosen(look.display, look.view)
            self.name, self.profile = f"{display}: {view}", PROFILES.get(display, "")
            self.view = configuration.processor(display, view)
        elif self.name not in (SRGB, DISPLAY_P3):
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
            write_tiff(path, numbers, icc_profile(self.profile) if numbers.ndim == 3 and self.profile else None)
        else:
            self.save_png(path, numbers)

    def save_png(self, path: str | Path, numbers: NDArray[Any]) -> None:
        """Write whole numbers as PNG; sRGB has a chunk of its own there, other displays their ICC profile."""
        write_png(path, numbers, **self._stated)

    def png(self, numbers: NDArray[Any]) -> bytes:
        """The content of such a PNG."""
        return png_bytes(numbers, **self._stated)

    @property
    def _stated(self) -> dict[str, Any]:
        known = self.profile not in (SRGB, "")
        return {"profile": icc_profile(self.profile)} if known else {"srgb": self.profile == SRGB}

    def numbers(self, linear: NDArray[Any]) -> NDArray[np.uint8]:
        """8-bit display values of linear sRGB."""
        if self.name == SRGB:
            return srgb_encode(linear)
        return np.round(255.0 * self.values(linear)).astype(np.uint8)


def _view(name: str) -> tuple[str, Any]:
    """The display of a view of ACES, and what computes its values."""
    configuration = OcioConfiguration()
    displays = configuration.displays
    display_of = {view: display for display in reversed(NAMED) for view in displays[display]}
    if name not in display_of:
        raise InputError(f"there is no display {name!r:.80}: give one of {', '.join((SRGB, DISPLAY_P3, *display_of))}")
    return PROFILES[display_of[name]], configuration.processor(display_of[name], name)


def srgb_values(linear: NDArray[np.float64]) -> NDArray[np.float64]:
    """Display values 0…1 of linear ones (IEC 61966-2-1)."""
    cut = np.clip(linear, 0.0, 1.0)
    return np.where(cut <= 0.0031308, 12.92 * cut, 1.055 * cut ** (1 / 2.4) - 0.055)
