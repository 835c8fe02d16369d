"""Lobes: what the interface of each place gives for a facet width of its own, at a refractive index that all share.

The width γ enters eq. (3) through the facet density D = exp(−ln2 φ²/γ²) alone. So light, F, G and cosθ_r are taken
once, with flat facets, and D follows for any γ.
"""

from __future__ import annotations

import numpy as np

from hagoromo.measurement.sight import Array, Sight
from hagoromo.reflectance.torrance_sparrow import LN2, Cosines

FLAT = np.log(1e3)  # ln γ at which every facet density is 1


class Lobes:
    """The interface of N places under L lamps, by their own ln γ."""

    def __init__(self, seen: Sight, n: float) -> None:
        log_n1 = np.array([np.log(n - 1.0)])
        self._flat, self._angle2 = [], []
        for lamp in range(seen.irradiance.shape[1]):
            one = Cosines(*(cosine[:, lamp : lamp + 1] for cosine in seen.cosines))
            flat = Sight(one, seen.irradiance[:, lamp : lamp + 1]).interface(np.array([FLAT]), log_n1)[0][0]
            self._flat.append(flat)
            self._angle2.append(np.arccos(np.clip(one.half[:, 0], -1.0, 1.0)) ** 2)

    def at(self, log_gamma: Array) -> tuple[Array, Array]:
        """Value per unit of β F₀ at log_gamma (N,), and its derivative by ln γ: two (N, C)."""
        value, slope = np.zeros_like(self._flat[0]), np.zeros_like(self._flat[0])
        for flat, angle2 in zip(self._flat, self._angle2, strict=True):
            # Tanaka eq. (4)
            exponent = LN2 * angle2 * np.exp(-2.0 * log_gamma)
            density = np.exp(-exponent)
            value += flat * density[:, None]
            slope += flat * (2.0 * exponent * density)[:, None]
        return value, slope
