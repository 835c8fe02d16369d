"""The rival of the MERL study: GGX facets over a Lambertian body, fitted by SciPy.

f cosθ_i = k_d cosθ_i + k_s D G₂ F / (4 cosθ_r), with the GGX density and the height-correlated masking of Smith
(Walter, Marschner, Li & Torrance 2007; Heitz 2014), and the Fresnel term of a dielectric. Six numbers, as many as the
dichromatic Torrance–Sparrow model has: k_d per channel, k_s, roughness, n; eight where k_s has a colour.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

import hagoromo as hg

Array = NDArray[np.float64]
ROUGHNESSES = (0.02, 0.06, 0.2, 0.5)  # where fits start; the best of them counts
INDEX_RANGE = (1.02, 20.0)  # up to what makes the Fresnel term that of a metal


def fit_ggx(cosines: hg.Cosines, values: Array, used: NDArray[np.bool_], coloured: bool) -> Array:
    """The best model values (N, C) for readings `values` of equal relative noise; fitted where `used` (N,)."""
    channels = values.shape[1]
    specular = channels if coloured else 1
    fitted = hg.Cosines(*(np.asarray(cosine)[used] for cosine in cosines))
    weight = 1.0 / values[used]

    def residuals(x: Array) -> Array:
        return ((model(x, fitted, channels, specular) - values[used]) * weight).ravel()

    low = np.r_[np.zeros(channels), np.full(specular, np.log(1e-6)), np.log(0.002), np.log(INDEX_RANGE[0] - 1.0)]
    high = np.r_[np.full(channels, 10.0), np.full(specular, np.log(1e3)), 0.0, np.log(INDEX_RANGE[1] - 1.0)]
    body = np.percentile(values[used] / fitted.incidence, 20, axis=0)
    fits = []
    for roughness in ROUGHNESSES:
        start = np.r_[body, np.zeros(specular), np.log(roughness), np.log(0.5)]
        start = np.clip(start, low + 1e-9, high - 1e-9)
        robust: dict[str, Any] = {"loss": "soft_l1", "f_scale": 0.05, "x_scale": "jac", "max_nfev": 200}
        fits.append(least_squares(residuals, start, bounds=(low, high), **robust))
    best = min(fits, key=lambda fit: fit.cost)
    return model(best.x, cosines, channels, specular)


def model(x: Array, cosines: hg.Cosines, channels: int, specular: int) -> Array:
    """Values (N, C) at x = (k_d, ln k_s, ln roughness, ln(n − 1))."""
    width, n = np.exp(x[-2]), 1.0 + np.exp(x[-1])
    tan2 = 1.0 / cosines.half**2 - 1.0
    density = 1.0 / (np.pi * width**2 * cosines.half**4 * (1.0 + tan2 / width**2) ** 2)
    masking = 1.0 / (1.0 + _slopes(cosines.incidence, width) + _slopes(cosines.view, width))
    c = cosines.deviation
    g = np.sqrt(n**2 + c**2 - 1.0)
    fresnel = 0.5 * ((g - c) / (g + c)) ** 2 * (1.0 + ((c * (g + c) - 1.0) / (c * (g - c) + 1.0)) ** 2)
    interface = density * masking * fresnel / (4.0 * cosines.view)
    return x[:channels] * cosines.incidence + np.exp(x[channels : channels + specular]) * interface


def _slopes(cosine: Array, width: float) -> Array:
    """Λ of Smith for GGX."""
    return 0.5 * (np.sqrt(1.0 + width**2 * (1.0 / cosine**2 - 1.0)) - 1.0)
