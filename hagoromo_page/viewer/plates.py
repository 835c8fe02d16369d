"""Plates: flat pictures in a viewer, each in layers: a rendered or spectral image, a photograph, a measurement's maps.

A plate is cut and shrunk to what its window shows before it is developed: of a large one only that is computed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.response import Response
from hagoromo.light.colour import srgb_encode
from hagoromo.light.spectrum import Spectrum
from hagoromo_page.viewer.layers import MATERIAL_COLOURS
from hagoromo_page.viewer.probe import Probe
from hagoromo_page.viewer.view_state import ViewTransform

LARGEST_NOISE = 0.2  # relative standard error that is shown brightest
NOISE_LAYER = f"uncertainty, 0…{100 * LARGEST_NOISE:g} %"
Picture = NDArray[Any]


@dataclass(frozen=True)
class PlateLight:
    """How a plate is lit and seen. strengths: factor of each lamp group; spectra: of those that have another than their
    own. response: of a camera in place of the eye. towards: (x, y), to the lamp over maps, page's axes, in a unit disc.
    """

    strengths: Mapping[int, float] = field(default_factory=dict)
    spectra: Mapping[int, Spectrum] = field(default_factory=dict)
    response: Response | None = None
    towards: tuple[float, float] = (-0.5, 0.5)


class Plate(Protocol):
    """A picture of `size` (width, height) in some layers. lamps: names of the lamp groups that it can be lit by.

    turns: whether a lamp is moved over it. cover: (height, width), how much of a pixel counts for exposure, 0…1.
    """

    size: tuple[int, int]
    layers: tuple[str, ...]
    lamps: tuple[str, ...]
    turns: bool

    @property
    def cover(self) -> Picture: ...  # noqa: D102

    def part(self, rows: slice, columns: slice, size: tuple[int, int]) -> Plate:
        """The pixels in `rows` and `columns`, shrunk to `size`."""
        ...

    def linear(self, layer: str, light: PlateLight, development: ViewTransform) -> Picture | None:
        """Linear sRGB (height, width, 3) of a layer of light; None of any other layer."""
        ...

    def coded(self, layer: str) -> Picture:
        """Display values (height, width, 3) uint8 of a layer that is no light."""
        ...

    def probe(self, x: float, y: float, light: PlateLight) -> Probe:
        """What stands at shares (x, y) of width and height."""
        ...


def shrunk(values: Picture, size: tuple[int, int]) -> Picture:
    """Means (height, width[, channels]) over the pixels of a smaller picture of `size` (width, height)."""
    import cv2

    if values.shape[1::-1] == size:
        return values
    if values.ndim == 2:
        return cv2.resize(values, size, interpolation=cv2.INTER_AREA)
    planes = [
        cv2.resize(np.ascontiguousarray(one), size, interpolation=cv2.INTER_AREA) for one in np.moveaxis(values, 2, 0)
    ]
    return np.stack(planes, axis=2)


def three_channels(values: Picture) -> Picture:
    """The first three channels, or one thrice."""
    return values[..., :3] if values.shape[-1] >= 3 else np.repeat(values[..., :1], 3, axis=-1)


def as_bytes(values: Picture) -> NDArray[np.uint8]:
    """0…1 as 0…255, without a tone curve."""
    return np.rint(255.0 * np.clip(np.nan_to_num(values), 0.0, 1.0)).astype(np.uint8)


def grey(values: Picture) -> NDArray[np.uint8]:
    """0…1 (height, width) as grey values."""
    return np.repeat(as_bytes(np.asarray(values, np.float64))[..., None], 3, axis=2)


def in_colours(share: Picture, known: Picture) -> NDArray[np.uint8]:
    """0…1 as Matplotlib's colours inferno, black to pale yellow; what is not known is grey."""
    import matplotlib

    shown = matplotlib.colormaps["inferno"](np.clip(np.nan_to_num(share, nan=1.0), 0.0, 1.0), bytes=True)[..., :3]
    return np.where(np.asarray(known, bool)[..., None], shown, np.uint8(64)).astype(np.uint8)


def in_two_colours(share: Picture, known: Picture) -> NDArray[np.uint8]:
    """−1…1 from blue over white to red; what is not known is grey."""
    import matplotlib

    level = 0.5 + 0.5 * np.clip(np.nan_to_num(share), -1.0, 1.0)
    shown = matplotlib.colormaps["RdBu_r"](level, bytes=True)[..., :3]
    return np.where(np.asarray(known, bool)[..., None], shown, np.uint8(64)).astype(np.uint8)


def scaled(values: Picture, known: Picture) -> NDArray[np.uint8]:
    """Grey from the smallest to the largest known value."""
    known = np.asarray(known, bool) & np.isfinite(values)
    if not known.any():
        return grey(np.zeros(values.shape))
    low, high = float(values[known].min()), float(values[known].max())
    return grey(np.where(known, (values - low) / max(high - low, 1e-30), 0.0))


def numbered(numbers: NDArray[np.int64]) -> NDArray[np.uint8]:
    """Materials 1, 2, … each in a colour; 0 black."""
    table = np.array([(0.0, 0.0, 0.0), *MATERIAL_COLOURS])
    return srgb_encode(table[np.where(numbers > 0, (numbers - 1) % len(MATERIAL_COLOURS) + 1, 0)])
