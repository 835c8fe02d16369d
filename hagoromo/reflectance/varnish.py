"""Varnish: a clear, smooth layer over the body of a plane, which absorbs: it makes colours darker and more saturated.

    f_body = (1/n²) T(θ_i) T(θ_r) e^{−τ(1/μ_i + 1/μ_r)} (ρ/π)/(1 − ρ K) cosθ_i,   ρ = π α c_b
    K = 2∫₀¹ R(μ) e^{−2τ/μ} μ dμ

T = 1 − F is Fresnel's transmittance of the layer of index n, μ_i and μ_r are cosines within it (sinθ = n sinθ'), and
τ is the optical depth of one passage along the normal. R is the reflectance from within, 1 beyond the critical angle.
Light that the body sends up and the layer sends back is scattered by the body again: 1/(1 − ρ K) sums all of it. Exact
for a Lambert body under a flat layer, at every wavelength (Saunderson, J. Opt. Soc. Am. 32 (1942) 727, with the angles
of Wolff, J. Opt. Soc. Am. A 11 (1994) 2956). What the layer itself reflects is the light of the interface: β, γ, n.

The colour as it shows is that of light along the normal, c_b T₀² e^{−2τ}/n²/(1 − ρ K); angles change it by a grey
factor.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import drjit as dr
import numpy as np

from hagoromo.backend import Float
from hagoromo.reflectance.body import LambertBody, is_number

NODES = 48  # of the internal reflectance
LEAST_COSINE = 1e-6  # keeps quotients of cosines finite where nothing is seen or lit
VARNISH_N_RANGE = (1.0, 3.0)  # admissible index
VARNISH_DEPTH_RANGE = (0.0, 20.0)  # admissible τ: a body under more is black


@dataclass(frozen=True, kw_only=True)
class Varnish(LambertBody):
    """varnish_n: refractive index of the layer, 1: air. varnish_depth: its optical depth τ along the normal."""

    varnish_n: float = 1.0
    varnish_depth: float = 0.0

    def body_factor(self, incidence: Float, view: Float, phase: Float) -> Float:
        """T(θ_i) T(θ_r)/T₀² e^{−τ(1/μ_i + 1/μ_r − 2)}, 1 along the normal."""
        whole = super().body_factor(incidence, view, phase)
        if is_number(self.varnish_n, 1.0) and is_number(self.varnish_depth, 0.0):
            return whole
        (lamp, down), (eye, up) = (refracted(cosine, self.varnish_n) for cosine in (incidence, view))
        passed = lamp * eye / dr.square(along_normal(self.varnish_n))
        return whole * passed * dr.exp(self.varnish_depth * (2.0 - dr.rcp(down) - dr.rcp(up)))

    def shown_colour(self, colour: Any, alpha: Float) -> Any:
        """c_b T₀² e^{−2τ}/n²/(1 − ρ K), of numbers n and τ."""
        n, depth = self.varnish_n, self.varnish_depth
        if n == 1.0 and depth == 0.0:
            return super().shown_colour(colour, alpha)
        passed = along_normal(n) ** 2 * math.exp(-2.0 * depth) / n**2
        shown = passed * colour / (1.0 - math.pi * alpha * colour * sent_back(n, depth))
        return super().shown_colour(shown, alpha)


def refracted(cosine: Float, n: Float) -> tuple[Float, Float]:
    """Transmittance T of unpolarised light from air at cosθ, and its cosine within the layer.

    In a form of eq. (5) whose terms do not cancel, so that T is 1 for n = 1 in single precision, too.
    """
    c = dr.fmax(cosine, LEAST_COSINE)
    g = dr.sqrt((n - 1.0) * (n + 1.0) + c * c)
    passed = 2.0 * c * g * (1.0 / dr.square(c + g) + n * n / dr.square(n * n * c + g))
    return passed, g / n


def along_normal(n: Float) -> Float:
    """T of light along the normal, 4n/(n + 1)²."""
    return 4.0 * n / ((n + 1.0) * (n + 1.0))


@lru_cache(maxsize=256)
def sent_back(n: float, depth: float) -> float:
    """K: share of the light that the body sends up which the layer sends back to it.

    Beyond the critical angle in closed form, μ_c² E₃(2τ/μ_c); below it over the cosine outside, c² = n²(μ² − μ_c²).
    """
    from scipy.special import expn

    critical = math.sqrt(1.0 - 1.0 / n**2)
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    outside, weights = 0.5 + 0.5 * nodes, 0.5 * weights
    within = np.sqrt(critical**2 + (outside / n) ** 2)
    passed = np.array([refracted(float(cosine), n)[0] for cosine in outside])
    below = 2.0 / n**2 * np.sum(weights * outside * (1.0 - passed) * np.exp(-2.0 * depth / within))
    beyond = 2.0 * critical**2 * expn(3, 2.0 * depth / critical) if critical > 0.0 else 0.0
    return float(below + beyond)
