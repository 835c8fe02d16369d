"""Lobes: the interface value of each sample for its own facet width, at one refractive index.

The width γ enters eq. (3) only through the facet density D = exp(−ln2 φ²/γ²). So irradiance, F, G and cosθ_r are
evaluated once, with flat facets, and D is multiplied in for any γ.
"""

from __future__ import annotations

import numpy as np

from hagoromo.measurement.sight import Array, Sight
from hagoromo.reflectance.facets import LN2
from hagoromo.reflectance.torrance_sparrow import Cosines

FLAT = np.log(1e3)  # ln γ at which every facet density is 1


class Lobes:
    """The interface of N samples under L lamps, each with its own ln γ."""

    def __init__(self, sight: Sight, n: float) -> None:
        log_n1 = np.array([np.log(n - 1.0)])
        self._flat, self._angle2 = [], []
        for lamp in range(sight.irradiance.shape[1]):
            one = Cosines(*(cosine[:, lamp : lamp + 1] for cosine in sight.cosines))
            flat = Sight(one, sight.irradiance[:, lamp : lamp + 1]).interface(np.array([FLAT]), log_n1)[0][0]
            self._flat.append(flat)
            self._angle2.append(np.arccos(np.clip(one.half[:, 0], -1.0, 1.0)) ** 2)

    def evaluate(self, log_gamma: Array) -> tuple[Array, Array]:
        """Value per unit of β F₀ at log_gamma (N,), and its derivative by ln γ: two (N, C)."""
        value, slope = np.zeros_like(self._flat[0]), np.zeros_like(self._flat[0])
        for flat, angle2 in zip(self._flat, self._angle2, strict=True):
            # Tanaka eq. (4)
            exponent = LN2 * angle2 * np.exp(-2.0 * log_gamma)
            density = np.exp(-exponent)
            value += flat * density[:, None]
            slope += flat * (2.0 * exponent * density)[:, None]
        return value, slope
