"""Dichromatic Torrance–Sparrow reflection (MODEL §2, Tanaka eq. 2–6), its facets with tails where `nu` says so.

Directions are unit and leave the surface. Every function takes Python floats or Dr.Jit arrays alike and is
differentiable; NumPy arrays are not accepted (Dr.Jit would treat them element by element in Python).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import drjit as dr
import numpy as np

from hagoromo.backend import Array3f, Float, clip
from hagoromo.reflectance.facets import GAUSSIAN, facet_density_at, is_gaussian, polynomial

ARCSIN_TERMS = tuple(4.0**k / (2.0 * k * k * math.comb(2 * k, k)) for k in range(1, 10))  # of arcsin²(√x)/x
ARCCOS_DEGREE = 6
SMALLEST_COSINE = 1e-6  # keeps quotients of cosines finite where the reflectance is 0 anyway


def _arccos_terms() -> tuple[float, ...]:
    """Polynomial of arccos²(1 − s)/s for s of 0…1, by its values at the roots of Chebyshev's polynomial."""
    roots = 0.5 + 0.5 * np.cos(math.pi * (np.arange(ARCCOS_DEGREE + 1) + 0.5) / (ARCCOS_DEGREE + 1))
    return tuple(np.polynomial.polynomial.polyfit(roots, np.arccos(1.0 - roots) ** 2 / roots, ARCCOS_DEGREE).tolist())


ARCCOS_TERMS = _arccos_terms()


class Cosines(NamedTuple):
    """The angles that the reflectance depends on, as cosines."""

    incidence: Float  # cosθ_i = N·L
    view: Float  # cosθ_r = N·V
    half: Float  # cosφ = N·Q
    deviation: Float  # cosθ_Q = V·Q


class Weights(NamedTuple):
    """Geometric weights of eq. (2): f = body · c_b(λ) + interface · e  [1/sr]."""

    body: Float  # α cosθ_i [1/sr]
    interface: Float  # β D F G / cosθ_r [1/sr]


def cosines(normal: Array3f, to_lamp: Array3f, to_eye: Array3f) -> Cosines:
    """The four cosines of MODEL §2 for unit vectors `normal`, `to_lamp`, `to_eye`.

    With χ = ∠(L,V) the half vector Q = (L+V)/|L+V| has |L+V| = 2 cos(χ/2) and V·Q = cos(χ/2).
    """
    incidence, view = dr.dot(normal, to_lamp), dr.dot(normal, to_eye)
    deviation = cos_deviation(dr.dot(to_lamp, to_eye))
    half = (incidence + view) / (2.0 * deviation)
    return Cosines(incidence, view, clip(half, -1.0, 1.0), deviation)


def cos_deviation(cos_phase: Float) -> Float:
    """cosθ_Q = cos(χ/2) from cosχ = L·V; kept above 0, where L = −V makes the half vector undefined."""
    return dr.sqrt(dr.fmax(0.5 + 0.5 * cos_phase, SMALLEST_COSINE**2))


def facet_density(cos_half: Float, gamma: Float, nu: Float = GAUSSIAN) -> Float:
    """Facets that face the half vector: D = (1 + (2^{1/ν} − 1) φ²/γ²)^{−ν}, 1 at its peak.

    cos_half: cosφ. gamma: half width at half maximum γ [rad], for every ν. nu: exponent ν of the tails, 0.3 or more;
    infinity, the default, is eq. (4), D = exp(−ln2 φ²/γ²). Stable for every ν; a Dr.Jit array may hold infinity, too.
    φ² is taken as arccos² through a form that stays smooth at φ = 0 (where arccos has an infinite slope).
    """
    return facet_density_at(squared_angle(cos_half), gamma, nu)


def squared_angle(cosine: Float) -> Float:
    """φ² from cosφ, finite slope at φ = 0: below 0.1 rad by the series of arccos² in s = 1 − cosφ, else arccos²."""
    s = dr.fmax(1.0 - cosine, 0.0)
    # arccos(1−s)² = 2s + s²/3 + 4s³/45 + s⁴/35 + …  (relative error < 1e-9 for s < 0.005)
    near = s * (2.0 + s * (1.0 / 3.0 + s * (4.0 / 45.0 + s / 35.0)))
    far = dr.acos(clip(cosine, -1.0 + 1e-7, 1.0 - 0.004))
    return dr.select(s < 0.005, near, far * far)


def squared_angle_ahead(cosine: Float) -> Float:
    """φ² from cosφ for φ up to π/2: a polynomial (relative error < 4e-7), quicker than `squared_angle`."""
    s = dr.fmax(1.0 - cosine, 0.0)
    return s * polynomial(s, ARCCOS_TERMS)


def squared_angle_of(sine_squared: Float, cosine: Float) -> Float:
    """φ² from sin²φ and cosφ, with the digits that cosφ has lost near φ = 0, and a finite slope there.

    In single precision cosφ keeps φ² to 1e-7, which is the whole square of a half width of 0.0003.
    """
    # arcsin²(√x) = x + x²/3 + 8x³/45 + 4x⁴/35 + …  (relative error < 1e-14 for x < 0.04)
    x = dr.fmin(sine_squared, 0.04)
    near = x * polynomial(x, ARCSIN_TERMS)
    return dr.select((sine_squared < 0.04) & (cosine > 0.0), near, squared_angle(cosine))


def fresnel(cos_deviation: Float, n: Float) -> Float:
    """Unpolarised Fresnel reflectance of a dielectric with refractive index `n`, see `normal_fresnel`."""
    c = cos_deviation
    g = dr.sqrt(n * n + c * c - 1.0)
    # Tanaka eq. (5), with the c² that is misprinted as c
    return 0.5 * dr.square((g - c) / (g + c)) * (1.0 + dr.square((c * (g + c) - 1.0) / (c * (g - c) + 1.0)))


def normal_fresnel(n: Float) -> Float:
    """F₀ = ((n − 1)/(n + 1))²: Fresnel's reflectance along the normal. n: a number or any array."""
    return ((n - 1.0) / (n + 1.0)) ** 2


def masking(at: Cosines) -> Float:
    """Share of facets neither shadowed nor masked: G = min{1, 2 cosφ cosθ_r/cosθ_Q, 2 cosφ cosθ_i/cosθ_Q}."""
    # Tanaka eq. (6)
    return dr.fmin(1.0, 2.0 * at.half * dr.fmin(at.view, at.incidence) / at.deviation)


def torrance_sparrow(
    normal: Array3f,
    to_lamp: Array3f,
    to_eye: Array3f,
    alpha: Float,
    beta: Float,
    gamma: Float,
    n: Float,
    nu: Float = GAUSSIAN,
) -> Weights:
    """Radiance per unit irradiance facing the lamp, f(N; L, V), as its two geometric weights [1/sr].

    f = α cosθ_i c_b + β D(φ; γ, ν) F(θ_Q,n) G(N,V,L) / cosθ_r e; both are 0 where cosθ_i ≤ 0 or cosθ_r ≤ 0.
    nu: exponent ν of the facets' tails; infinity: Gaussian facets.
    """
    at = cosines(normal, to_lamp, to_eye)
    if is_gaussian(nu):
        return weights_at(at, alpha, beta, gamma, n)
    across = dr.cross(normal, to_lamp + to_eye)  # of length 2 cosθ_Q sinφ
    sine_squared = dr.squared_norm(across) / dr.square(2.0 * at.deviation)
    return _weights(at, squared_angle_of(sine_squared, at.half), alpha, beta, gamma, n, nu)


def weights_at(at: Cosines, alpha: Float, beta: Float, gamma: Float, n: Float, nu: Float = GAUSSIAN) -> Weights:
    """As `torrance_sparrow`, from the cosines."""
    return _weights(at, squared_angle(at.half), alpha, beta, gamma, n, nu)


def _weights(at: Cosines, squared_half: Float, alpha: Float, beta: Float, gamma: Float, n: Float, nu: Float) -> Weights:
    """As `weights_at`, with φ² [rad²]."""
    lit = (at.incidence > 0.0) & (at.view > 0.0)
    # Tanaka eq. (3); below a horizon the divisor is 1, so that no inf or NaN arises
    view = dr.select(lit, at.view, 1.0)
    interface = beta * facet_density_at(squared_half, gamma, nu) * fresnel(at.deviation, n) * masking(at) / view
    return Weights(dr.select(lit, alpha * at.incidence, 0.0), dr.select(lit, interface, 0.0))
