"""Other programs: lights in the terms of Mitsuba, glTF and UsdLux, as plain values; the writers of these formats know
nothing else of a light.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from hagoromo.light.spectrum import Spectrum

Array = NDArray[np.float64]
Lost = Sequence[str]  # what a format does not keep of a light, a line each


class MitsubaPlugin(NamedTuple):
    """An object of Mitsuba: tag, type, values by name, objects within it. maps: channels of EXR files by name."""

    tag: str
    kind: str
    values: Mapping[str, Any]
    parts: Sequence[MitsubaPlugin] = ()
    maps: Mapping[str, Mapping[str, NDArray[np.float32]]] = {}


class GltfLight(NamedTuple):
    """A light of KHR_lights_punctual, which shines along the −z of its place (4, 4); strength: times the spectrum.
    cone: angles where it begins to fall and where it ends [rad], of a spot.
    """

    kind: str
    place: Array
    spectrum: Spectrum
    strength: float
    cone: tuple[float, float] | None = None


class UsdLight(NamedTuple):
    """A light of UsdLux at a place (4, 4); strength: times the spectrum, one number or (3,) of linear sRGB.

    as_point: whether its size does not count. focus: μ of its fall-off cos^μ about −z; None: it has none.
    """

    kind: str
    place: Array
    spectrum: Spectrum
    strength: float | Array
    inputs: Mapping[str, Any]
    as_point: bool = False
    focus: float | None = None


class InOtherPrograms(Protocol):
    """A light as other programs have it. None: the format has no such light."""

    @property
    def name(self) -> str:
        """Its name; empty: it has none."""
        ...

    def mitsuba(self) -> tuple[MitsubaPlugin | None, Lost]:
        """As Mitsuba 3 has it, and what is lost."""
        ...

    def gltf(self) -> tuple[GltfLight | None, Lost]:
        """As glTF has it, and what is lost."""
        ...

    def usd(self) -> tuple[UsdLight | None, Lost]:
        """As UsdLux has it, and what is lost."""
        ...


def at(position: Array, axes: Array | None = None) -> Array:
    """(4, 4) a place; axes: (3, 3) as columns, those of the world without."""
    place = np.eye(4)
    place[:3, :3] = np.eye(3) if axes is None else axes
    place[:3, 3] = position
    return place
