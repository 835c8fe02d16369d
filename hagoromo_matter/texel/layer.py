"""Layer: a flat layer of one level of a texel, in which light is followed to match levels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import drjit as dr

from hagoromo.backend import arrays
from hagoromo.reflectance.element import projected_area
from hagoromo.transport.textures import SeenAlong, Textures
from hagoromo.volume.texel import Texel

LAMP_DISTANCE_M = 1e3  # [m] distance of the lamps


def on_device(texel: Texel) -> Textures:
    """The levels of a texel as kernels read them."""
    return Textures([(texel, (texel.bottom, texel.top), 1.0)], kept=False)


class Layer:
    """A flat layer of level number `level` of a texel. tau: extinction where the density is 1 [1/m].

    elements: of every population. projected: whether extinction is by their projected area. textures: of the texel, see
    `on_device`; all its levels share them.
    """

    def __init__(
        self, texel: Texel, level: int, tau: float, elements: Sequence[str], projected: bool, textures: Textures
    ) -> None:
        self.texel, self.level, self.tau = texel, level, tau
        self.elements, self.projected, self.textures = tuple(elements), projected, textures
        self.box, self.row = arrays().UInt(0), dr.opaque(arrays().UInt, level)
        self.lattice, self.thickness = self.textures.lattice(self.box, self.row), texel.top - texel.bottom

    @property
    def tangents(self) -> list[Any]:
        """Of every population, whether its axes are tangents; see `Textures.axes`."""
        return [arrays().Bool(True) if element == "cylinder" else None for element in self.elements]

    def projected_area(self, population: int, axis: Any, direction: Any) -> Any:
        """Projected area of the elements of a population along a direction; 1 where extinction is isotropic."""
        return projected_area(self.elements[population], dr.dot(axis, direction)) if self.projected else 1.0

    def seen_along(self, direction: Any) -> SeenAlong | None:
        """How a direction sees the elements; None where extinction is isotropic."""
        if not self.projected:
            return None
        return SeenAlong(lambda population, axis: self.projected_area(population, axis, direction), self.tangents)
