"""Micro-elements: the reflectance seen on a small plane, cylinder or sphere (MODEL §2, "Micro-elements").

One Torrance–Sparrow reflectance is averaged over the normals that the eye sees of the element:
body parts in closed form, interface parts by Gauss–Legendre nodes placed where D is not negligible.
Directions are unit and leave the element; arguments are Python floats or Dr.Jit arrays alike.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator
from typing import Any, Literal, get_args

import drjit as dr
import numpy as np

from hagoromo.backend import Array3f, Float, arrays, clip
from hagoromo.reflectance.body import LAMBERT, LambertBody, is_number
from hagoromo.reflectance.facets import GAUSSIAN, LN2, facet_density_at, is_gaussian, tail_reach, tail_scale
from hagoromo.reflectance.torrance_sparrow import (
    Weights,
    cos_deviation,
    fresnel,
    squared_angle,
    squared_angle_ahead,
    squared_angle_of,
    torrance_sparrow,
)

Element = Literal["plane", "cylinder", "sphere"]
ELEMENTS: tuple[Element, ...] = get_args(Element)
NEGLIGIBLE_FACETS = 1e-4  # facet densities below this share of the peak are left out of the nodes
NEGLIGIBLE_TAILS = 1e-3  # of the largest, down to which integrands over τ are kept: tails that fall fast hold little
CYLINDER_NODES = 10
TAILED_NODES = 16  # across a cylinder whose facets have tails
SPHERE_NODES = 12, 12  # about Q and along φ
TAILED_SPHERE_NODES = 8, 18  # where facets have tails
TABLE_NODES = 32


def element_weights(
    element: str,
    axis: Array3f,
    to_lamp: Array3f,
    to_eye: Array3f,
    alpha: Float,
    beta: Float,
    gamma: Float,
    n: Float,
    nu: Float = GAUSSIAN,
    body_law: LambertBody = LAMBERT,
) -> Weights:
    """Weights of f for an `element` of ELEMENTS: `axis` is the plane's normal or the cylinder's tangent [1/sr].

    alpha, beta [1/sr], gamma [rad], n, nu: as in `torrance_sparrow`. body_law: of the body of a plane; other elements
    have Lambert's body.
    """
    if element == "plane":
        weights = torrance_sparrow(axis, to_lamp, to_eye, alpha, beta, gamma, n, nu)
        factor = body_law.body_factor(dr.dot(axis, to_lamp), dr.dot(axis, to_eye), dr.dot(to_lamp, to_eye))
        return weights if is_number(factor, 1.0) else Weights(weights.body * factor, weights.interface)
    cos_phase = dr.dot(to_lamp, to_eye)
    mirror = beta * fresnel(cos_deviation(cos_phase), n)
    if element == "cylinder":
        return Weights(
            alpha * cylinder_body(axis, to_lamp, to_eye), mirror * cylinder_facets(axis, to_lamp, to_eye, gamma, nu)
        )
    return Weights(alpha * sphere_body(cos_phase), mirror * sphere_facets(cos_phase, gamma, nu))


def projected_area(element: str, cos_axis: Float) -> Float:
    """Area of an element as seen along a direction, over half of its surface: A = mean |N·ω| over its normals, 0…1.

    A is |a·ω| of a plane (which has two faces), (2/π) sin∠(a, ω) of a cylinder and ½ of a sphere; its mean over all
    directions is ½ for each. cos_axis: a·ω of the unit axis and direction; its sign does not matter.
    With σ(ω) = τ ρ A(ω) the medium is one of micro-flakes (Jakob et al. 2010; Heitz et al. 2015): the light that it
    scatters from L to V, σ(V) f(a; L, V), is the same from V to L, and ∫ σ(V) f(a; L, V) dV ≤ σ(L).

    >>> projected_area("plane", 0.5), round(projected_area("cylinder", 0.0), 4), projected_area("sphere", 0.5)
    (0.5, 0.6366, 0.5)
    """
    if element == "plane":
        return dr.abs(cos_axis)
    if element == "cylinder":
        return (2.0 / math.pi) * dr.sqrt(dr.fmax(1.0 - cos_axis * cos_axis, 1e-12))
    return 0.5


def sphere_body(cos_phase: Float) -> Float:
    """Mean of cosθ_i over the visible sphere: (2/3π)(sin χ + (π−χ) cos χ), cosχ = L·V."""
    cosine = clip(cos_phase, -1.0, 1.0)
    phase = dr.acos(clip(cosine, -1.0 + 1e-7, 1.0 - 1e-7))
    return dr.fmax((2.0 / (3.0 * math.pi)) * (_sine(cosine) + (math.pi - phase) * cosine), 0.0)


def cylinder_body(axis: Array3f, to_lamp: Array3f, to_eye: Array3f) -> Float:
    """Mean of cosθ_i over the visible cylinder: sinθ_L (sin Δ + (π−Δ) cos Δ)/4, Δ between L and V along the axis."""
    lamp, eye = _across(axis, to_lamp), _across(axis, to_eye)
    sine_lamp, sine_eye = _length(lamp), _length(eye)
    cosine = clip(dr.dot(lamp, eye) / (sine_lamp * sine_eye), -1.0, 1.0)
    turn = dr.acos(clip(cosine, -1.0 + 1e-7, 1.0 - 1e-7))
    return 0.25 * sine_lamp * (_sine(cosine) + (math.pi - turn) * cosine)


def cylinder_facets(
    axis: Array3f,
    to_lamp: Array3f,
    to_eye: Array3f,
    gamma: Float,
    nu: Float = GAUSSIAN,
) -> Float:
    """∮ D G dψ / ∮ max(N·V,0) dψ over the normals that see both lamp and eye [1/sr without β F].

    cosθ_r cancels against the projected area, ∮ max(N·V,0) dψ = 2 sinθ_V. ψ is counted from Q across the axis, so
    cosφ = q cosψ with q = |Q across|; the nodes span |ψ| ≤ w with D(w) = NEGLIGIBLE_FACETS · D(0), cut by the
    horizons of lamp and eye. With 10 nodes the error is below 1 % of the largest value for γ ≤ 0.4.
    """
    if not is_gaussian(nu):
        return tailed_cylinder_facets(axis, to_lamp, to_eye, gamma, nu)
    lamp, eye = _across(axis, to_lamp), _across(axis, to_eye)
    sine_lamp, sine_eye = _length(lamp), _length(eye)
    deviation = cos_deviation(dr.dot(to_lamp, to_eye))
    half = (lamp + eye) / (2.0 * deviation)
    q = _length(half)
    cos_lamp, cos_eye = (
        clip(dr.dot(each, half) / (sine * q), -1.0 + 1e-7, 1.0 - 1e-7)
        for each, sine in ((lamp, sine_lamp), (eye, sine_eye))
    )
    # lamp at +arccos(cos_lamp), eye at −arccos(cos_eye) as counted from Q; both see N within ±π/2 of themselves
    tail = squared_angle(q) - math.log(NEGLIGIBLE_FACETS) / LN2 * gamma * gamma
    reach = dr.acos(clip(dr.cos(dr.fmin(dr.sqrt(tail), math.pi)) / q, -1.0 + 1e-7, 1.0 - 1e-7))
    first = dr.fmax(dr.acos(cos_lamp) - 0.5 * math.pi, -reach)
    last = dr.fmin(0.5 * math.pi - dr.acos(cos_eye), reach)
    width = dr.fmax(last - first, 0.0)
    incidence_ahead, incidence_aside = sine_lamp * cos_lamp, sine_lamp * _sine(cos_lamp)
    view_ahead, view_aside = sine_eye * cos_eye, -sine_eye * _sine(cos_eye)
    scale, narrow = 2.0 * q / deviation, 1.0 / (gamma * gamma)
    total: Any = 0.0
    for sine, cosine, weight in _turns(0.5 * (first + last), width):
        view = dr.fma(view_ahead, cosine, view_aside * sine)
        incidence = dr.fma(incidence_ahead, cosine, incidence_aside * sine)
        shade = clip(scale * cosine * dr.fmin(view, incidence), 0.0, 1.0)  # 0 where φ > π/2
        total = total + weight * dr.exp2(-squared_angle_ahead(q * cosine) * narrow) * shade
    return total * width / (2.0 * sine_eye)


def _turns(middle: Float, width: Float) -> Iterator[tuple[Float, Float, float]]:
    """Sine, cosine and weight of the nodes across a cylinder, which are alike on both sides of the `middle`."""
    sine, cosine = dr.sincos(middle)
    for node, weight in _legendre(CYLINDER_NODES)[CYLINDER_NODES // 2 :]:
        aside, ahead = dr.sincos((node - 0.5) * width)
        for side in (aside, -aside):
            yield dr.fma(sine, ahead, cosine * side), dr.fma(cosine, ahead, -sine * side), weight


def tailed_cylinder_facets(axis: Array3f, to_lamp: Array3f, to_eye: Array3f, gamma: Float, nu: Float) -> Float:
    """`cylinder_facets` of facets with tails: nodes at equal parts of τ in ψ = w sinh τ resolve core and tails alike.

    With 16 nodes the error is below 1 % of the largest value for γ of 0.002–0.5 and ν from 0.3. sin²φ is the sum of
    its parts along the axis and across, so that narrow facets keep their digits.
    """
    deviation = cos_deviation(dr.dot(to_lamp, to_eye))
    half = (to_lamp + to_eye) / (2.0 * deviation)
    along = dr.dot(axis, half)
    ahead = _across(axis, half)
    q = _length(ahead)
    ahead = ahead / q
    side = dr.cross(axis, ahead)
    lamp, eye = ((dr.dot(d, ahead), dr.dot(d, side)) for d in (to_lamp, to_eye))
    lamp_turn, eye_turn = dr.atan2(lamp[1], lamp[0]), dr.atan2(eye[1], eye[0])
    scale = tail_scale(gamma, nu, squared_angle_of(along * along, q))
    reach = tail_reach(scale, nu, 1, NEGLIGIBLE_TAILS)
    horizons = dr.fmax(lamp_turn, eye_turn) - 0.5 * math.pi, dr.fmin(lamp_turn, eye_turn) + 0.5 * math.pi
    start, end = (dr.asinh(clip(limit, -reach, reach) / scale) for limit in horizons)
    width = dr.fmax(end - start, 0.0)
    total: Any = 0.0
    for node, weight in _legendre(TAILED_NODES):
        rise, run = dr.sincosh(start + width * node)
        sine, cosine = dr.sincos(scale * rise)
        cos_half = q * cosine
        density = facet_density_at(squared_angle_of(along * along + dr.square(q * sine), cos_half), gamma, nu)
        facing = dr.fmin(lamp[0] * cosine + lamp[1] * sine, eye[0] * cosine + eye[1] * sine)
        total = total + weight * run * density * clip(2.0 * cos_half * facing / deviation, 0.0, 1.0)
    return total * width * scale / (2.0 * _length(_across(axis, to_eye)))


def sphere_facets(cos_phase: Float, gamma: Float, nu: Float = GAUSSIAN) -> Float:
    """∫ D G dN / π over the normals that see both lamp and eye [1/sr without β F], a function of χ alone.

    Kernels read it from `sphere_table`; with 12 nodes per angle the error is below 0.3 % of the largest value. Facets
    with tails have 8 nodes about Q and 18 along φ: below 1 % for γ of 0.002–0.5 and ν from 0.3.
    """
    total: Any = 0.0
    turns, parts = SPHERE_NODES if is_gaussian(nu) else TAILED_SPHERE_NODES
    for turn, turn_weight in _legendre(turns):
        for part, part_weight in _legendre(parts):
            total = total + turn_weight * part_weight * _sphere_node(cos_phase, gamma, nu, turn, part)
    return total


@functools.lru_cache(maxsize=256)
def sphere_table(
    gamma: float, entries: int, nodes: int = TABLE_NODES, nu: float = GAUSSIAN, graded: bool = False
) -> np.ndarray:
    """`sphere_facets` at `entries` equal steps of χ from 0 to π: (entries,) float32, for linear look-up in kernels.

    graded: at equal steps of `graded_place`, which are small near χ = π, where the value falls to 0 within the width of
    the facets; it may be smaller than a step of χ. Tables are kept, and cannot be written to.
    """
    Float64 = arrays().Float64
    turn, weight = np.array(_legendre(nodes)).T
    phases = np.linspace(0.0, math.pi, entries)
    if graded:
        phases = math.pi - phases[::-1] ** 2 / math.pi
    phase, across, along = dr.meshgrid(*map(Float64, (phases, turn, turn)), indexing="ij")
    exponent = nu if is_gaussian(nu) else dr.opaque(Float64, nu)
    node = _sphere_node(dr.cos(phase), dr.opaque(Float64, gamma), exponent, across, along)
    values = np.array(node).reshape(entries, nodes, nodes)
    table = (values @ weight @ weight).astype(np.float32)
    table.flags.writeable = False
    return table


def graded_place(cos_phase: Float) -> Float:
    """Place 0…1 in a graded `sphere_table` of the phase χ, from cosχ = L·V: 1 − √(1 − χ/π)."""
    return 1.0 - dr.sqrt(1.0 - dr.acos(clip(cos_phase, -1.0, 1.0)) / math.pi)


def _sphere_node(cos_phase: Float, gamma: Float, nu: Float, turn: Float, part: Float) -> Float:
    """Integrand of `sphere_facets` on the unit square: ω = turn · π/2 about the pole Q, φ = part · its largest value.

    The horizon of lamp and eye is tanφ = cotθ_Q / |cosω|; the four quadrants of ω are alike. For facets with tails
    φ = w sinh τ, and τ = part · its largest value.
    """
    deviation = cos_deviation(cos_phase)
    across = dr.sqrt(dr.fmax(1.0 - deviation * deviation, 0.0)) * dr.cos(0.5 * math.pi * turn)
    horizon = dr.atan2(deviation, across)
    if is_gaussian(nu):
        last = dr.fmin(horizon, gamma * math.sqrt(-math.log(NEGLIGIBLE_FACETS) / LN2))
        half = last * part
        density = dr.exp(-LN2 * dr.square(half / gamma))
    else:
        scale = tail_scale(gamma, nu)
        span = dr.asinh(dr.fmin(horizon, tail_reach(scale, nu, 2, NEGLIGIBLE_TAILS)) / scale)
        sine, cosine = dr.sincosh(span * part)
        half, last = scale * sine, span * scale * cosine
        density = facet_density_at(half * half, gamma, nu)
    least = dr.cos(half) * deviation - dr.sin(half) * across
    shade = clip(2.0 * dr.cos(half) * least / deviation, 0.0, 1.0)
    return 2.0 * last * density * shade * dr.sin(half)  # 4 quadrants of π/2, over π


def _across(axis: Array3f, direction: Array3f) -> Array3f:
    """Part of `direction` across the unit `axis`."""
    return direction - axis * dr.dot(axis, direction)


def _length(vector: Array3f) -> Float:
    """Length, kept above 0: a direction along the axis has no part across it."""
    return dr.sqrt(dr.fmax(dr.squared_norm(vector), 1e-12))


def _sine(cosine: Float) -> Float:
    return dr.sqrt(dr.fmax(1.0 - cosine * cosine, 1e-14))


def _legendre(count: int) -> list[tuple[float, float]]:
    """Gauss–Legendre nodes and weights on [0, 1]."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return [(0.5 + 0.5 * float(x), 0.5 * float(w)) for x, w in zip(nodes, weights, strict=True)]
