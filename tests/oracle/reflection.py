"""Eq. (2)–(6) and the micro-elements of MODEL §2, in float64: closed forms of the body parts, quadrature of the rest.

Written from the equations alone. Directions are unit, (points, 3), and leave the matter; gives the geometric weights of
body and interface [1/sr], (points,) each. f = body · c_b(λ) + interface · e(λ).
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

import hagoromo as hg

TURNS = 48  # Gauss–Legendre nodes over the normals of a cylinder, on each side of a kink
POLAR, ROUND = 64, 128  # nodes over the normals of a sphere about the half vector
PHASES = 40  # Chebyshev nodes over ∠(L, V) of the sphere's interface
Array = NDArray[np.float64]
Weights = tuple[Array, Array]


def element_weights(material: hg.Reflectance, axis: Array, to_lamp: Array, to_eye: Array) -> Weights:
    """Weights of f for the material's micro-element; `axis`: the plane's normal or the cylinder's tangent."""
    return {"plane": plane, "cylinder": cylinder, "sphere": sphere}[material.element](material, axis, to_lamp, to_eye)


def plane(material: hg.Reflectance, normal: Array, to_lamp: Array, to_eye: Array) -> Weights:
    """f(N; L, V), eq. (2) and (3)."""
    cos_i, cos_r = dot(normal, to_lamp), dot(normal, to_eye)
    deviation = half_phase(dot(to_lamp, to_eye))
    cos_half = np.clip((cos_i + cos_r) / (2.0 * deviation), -1.0, 1.0)
    lit = (cos_i > 0.0) & (cos_r > 0.0)
    masking = np.minimum(1.0, 2.0 * cos_half * np.minimum(cos_i, cos_r) / deviation)  # (6)
    facets = material.beta * density(np.arccos(cos_half), material) * fresnel(deviation, material.n)
    return (
        np.where(lit, material.alpha * cos_i, 0.0),
        np.where(lit, facets * masking / np.where(lit, cos_r, 1.0), 0.0),
    )


def density(angle: Array, material: hg.Reflectance) -> Array:
    """D(φ), eq. (4); with a finite ν, that of Student's t: (1 + (2^{1/ν} − 1) φ²/γ²)^{−ν}."""
    ratio, nu = (angle / material.gamma) ** 2, material.nu
    if math.isinf(nu):
        return np.exp(-math.log(2.0) * ratio)
    return (1.0 + (2.0 ** (1.0 / nu) - 1.0) * ratio) ** -nu


def fresnel(c: Array, n: float) -> Array:
    """F(θ_Q, n), eq. (5) with c² in g²; c = cosθ_Q."""
    g = np.sqrt(n * n + c * c - 1.0)
    return 0.5 * ((g - c) / (g + c)) ** 2 * (1.0 + ((c * (g + c) - 1.0) / (c * (g - c) + 1.0)) ** 2)


def sphere(material: hg.Reflectance, axis: Array, to_lamp: Array, to_eye: Array) -> Weights:
    """∫ f max(N·V, 0) dN / π, a function of χ = ∠(L, V) alone."""
    cosine = np.clip(dot(to_lamp, to_eye), -1.0, 1.0)
    chi = np.arccos(cosine)
    body = material.alpha * (2.0 / (3.0 * math.pi)) * (np.sin(chi) + (math.pi - chi) * cosine)
    if material.beta == 0.0 or chi.size == 0:
        return body, np.zeros_like(body)
    low, high = float(chi.min()), max(float(chi.max()), float(chi.min()) + 1e-6)
    nodes = np.polynomial.chebyshev.chebpts1(PHASES)
    values = [_sphere_interface(material, 0.5 * (low + high) + 0.5 * (high - low) * x) for x in nodes]
    series = np.polynomial.chebyshev.chebfit(nodes, values, PHASES - 1)
    return body, np.asarray(np.polynomial.chebyshev.chebval((2.0 * chi - low - high) / (high - low), series), float)


def _sphere_interface(material: hg.Reflectance, chi: float) -> float:
    """∫ β D F G dN / π over the normals that see lamp and eye: cosθ_r cancels against the projected area.

    Normals N by their angle φ from Q and ω about it; along each ω the integrand is smooth but where G leaves 1, and
    ends at the horizon of the nearer of lamp and eye.
    """
    c, s = math.cos(0.5 * chi), math.sin(0.5 * chi)  # L and V = (±s, 0, c) about Q = (0, 0, 1)
    turn, turn_weight = gauss(ROUND // 4, 0.0, 0.5 * math.pi)  # the four quadrants of ω are alike
    across = s * np.cos(turn)
    horizon = np.arctan2(c, across)  # cosφ c − sinφ across = 0
    # G = 1 up to 2 cosφ (cosφ c − sinφ across) = c, that is c cos 2φ = across sin 2φ
    kink = np.minimum(0.5 * np.arctan2(c, across), horizon)
    total = 0.0
    for first, last in ((np.zeros_like(kink), kink), (kink, horizon)):
        phi, weight = gauss(POLAR, first[:, None], last[:, None])
        least = np.cos(phi) * c - np.sin(phi) * across[:, None]
        shade = np.clip(2.0 * np.cos(phi) * least / max(c, 1e-12), 0.0, 1.0)
        total += 4.0 * np.sum(turn_weight[:, None] * weight * density(phi, material) * shade * np.sin(phi))
    return material.beta * float(fresnel(np.array(c), material.n)) * total / math.pi


def cylinder(material: hg.Reflectance, axis: Array, to_lamp: Array, to_eye: Array) -> Weights:
    """∮ f max(N·V, 0) dψ / ∮ max(N·V, 0) dψ over N(ψ) ⟂ axis."""
    lamp = to_lamp - axis * dot(axis, to_lamp)[:, None]
    eye = to_eye - axis * dot(axis, to_eye)[:, None]
    sin_lamp, sin_eye = (np.sqrt(np.maximum(dot(v, v), 1e-24)) for v in (lamp, eye))
    turn = np.arccos(np.clip(dot(lamp, eye) / (sin_lamp * sin_eye), -1.0, 1.0))  # Δ
    body = 0.25 * material.alpha * sin_lamp * (np.sin(turn) + (math.pi - turn) * np.cos(turn))
    if material.beta == 0.0:
        return body, np.zeros_like(body)
    deviation = half_phase(dot(to_lamp, to_eye))
    # normals ψ counted from the eye towards the lamp: N·V = sin_eye cosψ, N·L = sin_lamp cos(ψ − Δ)
    first, last = turn - 0.5 * math.pi, np.full_like(turn, 0.5 * math.pi)
    middle = np.clip(np.arctan2(sin_eye - sin_lamp * np.cos(turn), sin_lamp * np.sin(turn)), first, last)
    total = np.zeros_like(turn)
    for begin, end in ((first, middle), (middle, last)):  # N·V is the smaller cosine on one side of `middle`
        psi, weight = gauss(TURNS, begin[:, None], end[:, None])
        view, incidence = sin_eye[:, None] * np.cos(psi), sin_lamp[:, None] * np.cos(psi - turn[:, None])
        cos_half = np.clip((view + incidence) / (2.0 * deviation[:, None]), -1.0, 1.0)
        shade = np.clip(2.0 * cos_half * np.minimum(view, incidence) / deviation[:, None], 0.0, 1.0)
        total += np.sum(weight * density(np.arccos(cos_half), material) * shade, axis=1)
    return body, material.beta * fresnel(deviation, material.n) * total / (2.0 * sin_eye)


def half_phase(cos_phase: Array) -> Array:
    """cosθ_Q = cos(χ/2)."""
    return np.sqrt(np.maximum(0.5 + 0.5 * cos_phase, 1e-24))


def dot(a: Array, b: Array) -> Array:
    """Scalar products, (points,)."""
    return np.sum(a * b, axis=-1)


def gauss(count: int, first: Any, last: Any) -> Weights:
    """Gauss–Legendre nodes and weights between `first` and `last`, along a last axis."""
    nodes, weights = _legendre(count)
    half = 0.5 * (np.asarray(last) - first)
    return first + half * (1.0 + nodes), half * weights


@cache
def _legendre(count: int) -> Weights:
    return np.polynomial.legendre.leggauss(count)
