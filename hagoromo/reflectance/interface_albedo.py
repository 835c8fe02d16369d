"""Interface albedo: how much of the light the interface of an element sends on, by quadrature."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import drjit as dr
import numpy as np

from hagoromo.backend import arrays
from hagoromo.reflectance.facets import GAUSSIAN, LN2, is_gaussian, tail_reach, tail_scale
from hagoromo.reflectance.torrance_sparrow import cosines, weights_at

NEGLIGIBLE = 1e-6  # facet densities below this share of the peak are left out
ELEMENT_NODES = 24  # normals of a sphere or cylinder over which the plane's albedo is averaged
VIEWS = np.radians([0, 15, 30, 45, 55, 65, 72, 78, 83, 86, 88, 89, 89.7])  # where energy conservation is checked


@lru_cache(maxsize=256)
def interface_albedo(
    gamma: float, n: float, nu: float = GAUSSIAN, element: str = "plane", angles: int = 48
) -> np.ndarray:
    """Albedo of the interface for β = 1, ∫ f dL over all lamp directions [sr], from 13 directions of view: (13,).

    gamma: half width γ of the facets [rad]. n: refractive index. nu: exponent ν of their tails. element: the plane's
    views run from along its normal to 89.7° from it, the cylinder's from across its tangent to 89.7° from there, and
    the sphere's are all alike. The plane by quadrature over the half vector Q, dL = 4 cosθ_Q dQ; the others are its
    mean over the normals that the eye sees: sphere 2∫μ A(μ) dμ, cylinder ½∮cosψ A(cosψ sinθ_V) dψ, A the plane's.
    """
    if element == "plane":
        return _plane_albedo(VIEWS, gamma, n, nu, angles)
    nodes, weights = np.polynomial.legendre.leggauss(ELEMENT_NODES)
    nodes, weights = (nodes + 1) / 2, weights / 2
    if element == "sphere":
        mean = 2.0 * np.sum(weights * nodes * _plane_albedo(np.arccos(nodes), gamma, n, nu, angles))
        return np.full(VIEWS.size, mean)
    turns = 0.5 * math.pi * nodes
    cosines_seen = np.cos(VIEWS)[:, None] * np.cos(turns)
    seen = _plane_albedo(np.arccos(cosines_seen).ravel(), gamma, n, nu, angles).reshape(cosines_seen.shape)
    return seen @ (0.5 * math.pi * weights * np.cos(turns))


def _plane_albedo(views: np.ndarray, gamma: float, n: float, nu: float, angles: int) -> np.ndarray:
    """`interface_albedo` of a plane from angles of view against its normal [rad]: (views,)."""
    Array3, Float64 = arrays().Array3f64, arrays().Float64
    polars, weights = _facet_nodes(gamma, nu, angles)
    turns = math.pi * (np.arange(2 * angles) + 0.5) / (2 * angles)  # one half of the turn: the other is alike
    grid = (Float64(axis) for axis in (views, polars, turns))
    view, polar, turn = dr.meshgrid(*grid, indexing="ij")
    half, to_eye = Array3(*_direction(polar, turn)), Array3(*_direction(view, 0.0))
    cos_eye = dr.dot(half, to_eye)
    to_lamp = 2.0 * cos_eye * half - to_eye
    width, index = dr.opaque(Float64, gamma), dr.opaque(Float64, n)  # literals would compile for every material
    exponent = nu if is_gaussian(nu) else dr.opaque(Float64, nu)
    f = weights_at(cosines(Array3(0, 0, 1), to_lamp, to_eye), 0.0, 1.0, width, index, exponent).interface
    values = np.array(dr.select(cos_eye > 0, 4.0 * cos_eye * f * dr.sin(polar), 0.0)).reshape(views.size, angles, -1)
    return values.sum(axis=2) @ weights * (math.pi / angles)


def _facet_nodes(gamma: float, nu: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Gauss–Legendre nodes of the angle φ between normal and half vector [rad], and their weights, (count,) each.

    Facets that are negligible are left out. With tails φ = w sinh τ, so that core and tails are resolved alike.
    """
    nodes, weights = np.polynomial.legendre.leggauss(count)
    if is_gaussian(nu):
        reach = min(math.pi / 2, gamma * math.sqrt(-math.log(NEGLIGIBLE) / LN2))
        return reach * (nodes + 1) / 2, reach / 2 * weights
    scale = tail_scale(gamma, nu)
    span = math.asinh(min(math.pi / 2, tail_reach(scale, nu, 2, NEGLIGIBLE)) / scale)
    places = span * (nodes + 1) / 2
    return scale * np.sinh(places), span / 2 * scale * np.cosh(places) * weights


def _direction(polar: Any, turn: Any) -> tuple[Any, Any, Any]:
    return dr.sin(polar) * dr.cos(turn), dr.sin(polar) * dr.sin(turn), dr.cos(polar)
