"""Lobes: the interface value of each sample for its own facet width, at one refractive index.

The width γ enters eq. (3) only through the facet density D. So irradiance, F, G and cosθ_r are evaluated once, with
flat facets, and D is multiplied in for any γ.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hagoromo.measurement.facets import facet_density
from hagoromo.measurement.sight import Array, Sight
from hagoromo.reflectance.facets import GAUSSIAN
from hagoromo.reflectance.material.material_estimate import MaterialEstimate
from hagoromo.reflectance.torrance_sparrow import Cosines

FLAT = np.log(1e3)  # ln γ at which every facet density is 1


@dataclass(frozen=True)
class LobeShape:
    """What all pixels of a material share beside n: ν of the tails of its facets, and its interface colour of mean 1.

    nu: one number, or one of each of N samples (N,). colour: one number per channel, none for a neutral interface.
    """

    nu: float | Array = GAUSSIAN
    colour: tuple[float, ...] = ()

    @classmethod
    def of(cls, material: MaterialEstimate) -> LobeShape:
        """That of a material."""
        return cls(material.nu, tuple(material.interface_colour))


class SampleLobes:
    """The interface of N samples under L lamps, each with its own ln γ."""

    def __init__(self, sight: Sight, n: float, shape: LobeShape | None = None) -> None:
        shape = LobeShape() if shape is None else shape
        log_n1, self._tail = np.array([np.log(n - 1.0)]), np.array(1.0 / shape.nu)
        colour = np.array(shape.colour) if shape.colour else np.ones(sight.irradiance.shape[2])
        self._flat, self._angle2 = [], []
        for lamp in range(sight.irradiance.shape[1]):
            one = Cosines(*(cosine[:, lamp : lamp + 1] for cosine in sight.cosines))
            flat = Sight(one, sight.irradiance[:, lamp : lamp + 1]).interface(np.array([FLAT]), log_n1)[0][0]
            self._flat.append(flat * colour)
            self._angle2.append(np.arccos(np.clip(one.half[:, 0], -1.0, 1.0)) ** 2)

    def evaluate(self, log_gamma: Array) -> tuple[Array, Array]:
        """Value per unit of β F₀ at log_gamma (N,), and its derivative by ln γ: two (N, C)."""
        value, slope = np.zeros_like(self._flat[0]), np.zeros_like(self._flat[0])
        for flat, angle2 in zip(self._flat, self._angle2, strict=True):
            density = facet_density(angle2, log_gamma, self._tail, with_tail=False)
            value += flat * density.value[:, None]
            slope += flat * density.by_log_gamma[:, None]
        return value, slope
