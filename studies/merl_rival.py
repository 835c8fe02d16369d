"""The fits of the MERL study by SciPy: GGX facets over a Lambertian body, and our own facets, with the same loss.

f cosθ_i = k_d cosθ_i + k_s I. GGX: I = D G₂ F / (4 cosθ_r), with the density and the height-correlated masking of Smith
(Walter, Marschner, Li & Torrance 2007; Heitz 2014). Ours: I = D G F / cosθ_r of eq. (2)–(6), D Gaussian or Student's.
F is that of a dielectric. Six numbers each: k_d per channel, k_s, width, n; one more for the tail of Student's facets,
two more where k_s has a colour. Written in NumPy, and sharing nothing with the package.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

import hagoromo as hg

Array = NDArray[np.float64]
WIDTHS = (0.002, 0.006, 0.02, 0.06, 0.2, 0.5)  # where fits start; the best of them counts
TAILS = (0.3, 1.0)  # 1/ν where fits of Student's facets start
LARGEST_TAIL = 1.0 / 0.3
INDEX_RANGE = (1.02, 20.0)  # up to what makes the Fresnel term that of a metal


@dataclass(frozen=True)
class Rival:
    """A model that SciPy fits. interface: of (cosines, width, n, tail); tails: whether the last has an effect."""

    interface: Callable[[hg.Cosines, float, float, float], Array]
    tails: bool = False
    coloured: bool = False

    def values(self, x: Array, cosines: hg.Cosines, channels: int) -> Array:
        """Values (N, C) at x = (k_d, ln k_s, ln width, ln(n − 1), 1/ν)."""
        strength = np.exp(x[channels:-3])
        interface = self.interface(cosines, float(np.exp(x[-3])), 1.0 + float(np.exp(x[-2])), float(x[-1]))
        return x[:channels] * cosines.incidence + strength * interface


def fit_rival(rival: Rival, cosines: hg.Cosines, values: Array, used: NDArray[np.bool_]) -> Array:
    """The best model values (N, C) for readings `values` of equal relative noise; fitted where `used` (N,)."""
    channels = values.shape[1]
    colours = channels if rival.coloured else 1
    fitted = hg.Cosines(*(np.asarray(cosine)[used] for cosine in cosines))
    weight = 1.0 / values[used]

    def residuals(x: Array) -> Array:
        return ((rival.values(x, fitted, channels) - values[used]) * weight).ravel()

    last = LARGEST_TAIL if rival.tails else 1e-9
    low = np.r_[np.zeros(channels), np.full(colours, np.log(1e-9)), np.log(1e-3), np.log(INDEX_RANGE[0] - 1.0), 0.0]
    high = np.r_[np.full(channels, 10.0), np.full(colours, np.log(1e5)), 0.5, np.log(INDEX_RANGE[1] - 1.0), last]
    body = np.percentile(values[used] / fitted.incidence, 20, axis=0)
    fits = []
    for width in WIDTHS:
        for tail in TAILS if rival.tails else (0.0,):
            start = np.r_[body, np.zeros(colours), np.log(width), np.log(0.5), tail]
            start = np.clip(start, low + 1e-10, high - 1e-10)
            robust: dict[str, Any] = {"loss": "soft_l1", "f_scale": 0.05, "x_scale": "jac", "max_nfev": 200}
            fits.append(least_squares(residuals, start, bounds=(low, high), **robust))
    best = min(fits, key=lambda fit: fit.cost)
    return rival.values(best.x, cosines, channels)


def ggx(cosines: hg.Cosines, width: float, n: float, tail: float) -> Array:
    """D G₂ F / (4 cosθ_r) of GGX (N, 1)."""
    tan2 = 1.0 / cosines.half**2 - 1.0
    density = 1.0 / (np.pi * width**2 * cosines.half**4 * (1.0 + tan2 / width**2) ** 2)
    masking = 1.0 / (1.0 + _slopes(cosines.incidence, width) + _slopes(cosines.view, width))
    return density * masking * _fresnel(cosines.deviation, n) / (4.0 * cosines.view)


def torrance_sparrow(cosines: hg.Cosines, width: float, n: float, tail: float) -> Array:
    """D G F / cosθ_r of eq. (2)–(6) (N, 1), with Gaussian facets where the tail 1/ν is 0."""
    u = (np.arccos(np.clip(cosines.half, -1.0, 1.0)) / width) ** 2
    density = 2.0**-u if tail < 1e-8 else (1.0 + (2.0**tail - 1.0) * u) ** (-1.0 / tail)
    masking = np.minimum(1.0, 2.0 * cosines.half * np.minimum(cosines.view, cosines.incidence) / cosines.deviation)
    return density * masking * _fresnel(cosines.deviation, n) / cosines.view


def _fresnel(c: Array, n: float) -> Array:
    g = np.sqrt(n**2 + c**2 - 1.0)
    return 0.5 * ((g - c) / (g + c)) ** 2 * (1.0 + ((c * (g + c) - 1.0) / (c * (g - c) + 1.0)) ** 2)


def _slopes(cosine: Array, width: float) -> Array:
    """Λ of Smith for GGX."""
    return 0.5 * (np.sqrt(1.0 + width**2 * (1.0 / cosine**2 - 1.0)) - 1.0)


GGX, GGX_COLOURED = "GGX + Lambert, SciPy", "GGX + Lambert, coloured, SciPy"
RIVALS = {
    "Gaussian, SciPy": Rival(torrance_sparrow),
    "Student-t, SciPy": Rival(torrance_sparrow, tails=True),
    "Student-t, coloured, SciPy": Rival(torrance_sparrow, tails=True, coloured=True),
    GGX: Rival(ggx),
    GGX_COLOURED: Rival(ggx, coloured=True),
}
