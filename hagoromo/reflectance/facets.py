"""Facets with tails: the law of the small mirrors' tilts in numerically stable forms (MODEL §2, "Tails").

With t = 1/ν and x = φ²/γ² the density is D = exp(−E), E = ln(1 + (2^t − 1) x)/t. It is written with quotients that are
smooth at t = 0, where E = ln2 · x is the Gaussian of eq. (4), so that one kernel serves every ν and infinity, too.
Arguments are Python floats or Dr.Jit arrays alike.
"""

from __future__ import annotations

import math
from typing import Annotated, Any

import drjit as dr
from msgspec import Meta

from hagoromo.backend import Bool, Float

LN2 = math.log(2.0)
GAUSSIAN = math.inf  # the exponent ν of the facets of eq. (4)
HALF_OF_GGX = math.sqrt(math.sqrt(2.0) - 1.0)  # tan γ over the width α of GGX, whose slopes are half as dense there
TAILS_OF_GGX = 2.0  # exponent ν of GGX at small angles: (1 + tan²θ/α²)^−2
LEAST_NU = 0.3  # below it D falls so slowly that its width is that of the hemisphere, whatever γ is
TailExponent = Annotated[float, Meta(ge=LEAST_NU)]  # ν of a file
LARGEST_NODE_NU = 1e4
EXPM1_TERMS = tuple(1.0 / math.factorial(k + 1) for k in range(9))  # of (e^z − 1)/z: below 1e-16 for |z| < 0.1
LOG1P_TERMS = tuple(1.0 / (2 * k + 1) for k in range(8))  # of artanh(s)/s: below 1e-14 for |s| < 1/7


def is_gaussian(nu: Float) -> bool:
    """Whether ν is the number infinity: then the Gaussian of eq. (4) is computed without any of the forms below."""
    return isinstance(nu, (int, float)) and math.isinf(nu)


def facet_density_at(squared_angle: Float, gamma: Float, nu: Float = GAUSSIAN) -> Float:
    """D = exp(−E) at the squared angle φ² [rad²] between normal and half vector, see `facet_exponent`."""
    if is_gaussian(nu):
        # Tanaka eq. (4)
        return dr.exp(-LN2 * squared_angle / (gamma * gamma))
    return dr.exp(-facet_exponent(squared_angle, gamma, nu))


def facet_exponent(squared_angle: Float, gamma: Float, nu: Float) -> Float:
    """E = −ln D = ν ln(1 + (2^{1/ν} − 1) φ²/γ²) ≥ 0 of facets at the squared angle φ² [rad²].

    gamma: half width at half maximum γ [rad]; nu: exponent ν of the tails. A Dr.Jit array may have entries ∞: they give
    ln2 φ²/γ².

    >>> round(facet_exponent(0.2**2, 0.2, 1.7) / math.log(2.0), 12)  # half of the maximum at φ = γ
    1.0
    """
    if is_gaussian(nu):
        return LN2 * squared_angle / (gamma * gamma)
    t = 1.0 / nu
    rise = tail_rise(t)
    straight = rise * squared_angle / (gamma * gamma)
    return straight * log1p_quotient(t * straight)


def tail_rise(t: Float) -> Float:
    """(2^t − 1)/t of t = 1/ν, the slope of E by φ²/γ² at φ = 0; ln2 at t = 0."""
    return LN2 * expm1_quotient(LN2 * t)


def facet_mass(squared_angle: Float, gamma: Float, nu: Float) -> Float:
    """Facets within the squared angle φ² [rad²]: M = (2g/γ²) ∫₀^φ D φ dφ, with g of `tail_rise`; 1 − D without tails.

    M = (1 − e^{−(1−t)E})/(1 − t), smooth at t = 1.
    """
    exponent = facet_exponent(squared_angle, gamma, nu)
    return exponent * expm1_quotient((1.0 / nu - 1.0) * exponent)


def squared_angle_of_mass(mass: Float, gamma: Float, nu: Float) -> Float:
    """φ² [rad²] within which facets have the `mass` M: the inverse of `facet_mass`."""
    t = 1.0 / nu
    exponent = mass * log1p_quotient((t - 1.0) * mass)
    return gamma * gamma * exponent * expm1_quotient(t * exponent) / tail_rise(t)


def tail_scale(gamma: Float, nu: Float, offset: Float = 0.0) -> Float:
    """Angle w [rad] at which the core of D ends and its tails begin: D(φ)/D(φ₀) = (1 + (φ² − φ₀²)/w²)^{−ν}.

    w² = γ²/(2^{1/ν} − 1) + φ₀². offset: φ₀² [rad²]. Angles ψ = w sinh τ at equal steps of τ resolve core and tails
    alike. For nodes alone: ν is limited to LARGEST_NODE_NU, beyond which sinh is straight over the whole of D.
    """
    t = dr.fmax(1.0 / nu, 1.0 / LARGEST_NODE_NU)
    return dr.sqrt(gamma * gamma / (t * tail_rise(t)) + offset)


def tail_reach(scale: Float, nu: Float, power: int, negligible: float) -> Float:
    """Angle ψ = w sinh T [rad] beyond which facets are left out: cosh^{power − 2ν} T = negligible.

    scale: w of `tail_scale`. power: 1 for integrals along a line, 2 over solid angle. Infinite, or nearly, for
    ν ≤ power/2, where the horizon ends the integral and not D. In the limit ν → ∞, D(ψ) = negligible.
    """
    t = dr.fmax(1.0 / nu, 1.0 / LARGEST_NODE_NU)
    doubled = -2.0 * math.log(negligible) * t / dr.fmax(2.0 - power * t, 1e-6)  # 2 ln cosh T
    bounded = dr.fmin(doubled, 40.0)
    return scale * dr.sqrt(bounded * expm1_quotient(bounded))


def expm1_quotient(z: Float) -> Float:
    """(e^z − 1)/z, smooth at z = 0, where it is 1."""
    near = abs(z) < 0.1
    away = _nonzero(near, z)
    return dr.select(near, polynomial(z, EXPM1_TERMS), (dr.exp(away) - 1.0) / away)


def log1p_quotient(z: Float) -> Float:
    """ln(1 + z)/z for z > −1, smooth at z = 0, where it is 1: near 0 by 2 artanh(z/(2 + z)) = ln(1 + z)."""
    near = abs(z) < 0.25
    away = _nonzero(near, z)
    s = dr.select(near, z / (2.0 + z), 0.0)
    series = 2.0 / (2.0 + z) * polynomial(s * s, LOG1P_TERMS)
    return dr.select(near, series, dr.log(1.0 + away) / away)


def _nonzero(near: Bool, z: Float) -> Float:
    """z where it is not `near` 0, else 1: no 0/0 arises in the form that is not chosen there."""
    return dr.select(near, 1.0, z)


def polynomial(z: Float, terms: tuple[float, ...]) -> Float:
    """Σ terms[k] z^k by Horner's rule."""
    total: Any = terms[-1]
    for term in reversed(terms[:-1]):
        total = total * z + term
    return total
