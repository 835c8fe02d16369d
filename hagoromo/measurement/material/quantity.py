"""Quantities of a material as functions of the parameters θ of its fit, as `parameters` has them.

Each takes rows θ (K, P) and gives its values (K,) with their gradients (K, P).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hagoromo.measurement.parameters import (
    LOG_GAMMA,
    LOG_N1,
    STRENGTH,
    TAIL,
    channels_of,
    colour_slice,
    contrasts,
    interface_colour,
)
from hagoromo.measurement.sight import Array, Sight
from hagoromo.reflectance.torrance_sparrow import Cosines

Quantity = Callable[[Array], tuple[Array, Array]]

SMALLEST = 1e-12  # [1/sr] smallest β F₀ whose logarithm is taken, and smallest α that is divided by
NODES, NARROWEST = 64, 5e-4  # of the quadrature of the albedo: Gauss–Legendre nodes of each part, and φ₀ [rad]


def coordinate(index: int) -> Quantity:
    """The quantity θ[index] itself."""

    def quantity(theta: Array) -> tuple[Array, Array]:
        return theta[:, index], np.broadcast_to(np.eye(theta.shape[1])[index], theta.shape)

    return quantity


def alpha(theta: Array) -> tuple[Array, Array]:
    """α: the mean of α c_b over the channels, as body colours have mean 1."""
    c, gradient = channels_of(theta), np.zeros_like(theta)
    gradient[:, :c] = 1.0 / c
    return theta[:, :c].mean(axis=1), gradient


def body_colour(channel: int) -> Quantity:
    """The quantity c_b of a channel."""

    def quantity(theta: Array) -> tuple[Array, Array]:
        c = channels_of(theta)
        alpha = np.maximum(theta[:, :c].mean(axis=1), SMALLEST)
        value, gradient = theta[:, channel] / alpha, np.zeros_like(theta)
        gradient[:, :c] = (np.eye(c)[channel] - value[:, None] / c) / alpha[:, None]
        return value, gradient

    return quantity


def colour_of_interface(channel: int) -> Quantity:
    """The quantity e of a channel, in the interface colour of mean 1."""

    def quantity(theta: Array) -> tuple[Array, Array]:
        c, gradient = channels_of(theta), np.zeros_like(theta)
        share = interface_colour(theta) / interface_colour(theta).sum(axis=1, keepdims=True)
        value = c * share[:, channel]
        gradient[:, colour_slice(c)] = value[:, None] * (contrasts(c)[channel] - share @ contrasts(c))
        return value, gradient

    return quantity


def log_beta(theta: Array) -> tuple[Array, Array]:
    """ln β, of the interface colour of mean 1."""
    value, gradient = _log_strength(theta)
    n = 1.0 + np.exp(theta[:, LOG_N1])
    gradient[:, LOG_N1] = -4.0 / (n + 1.0)
    return value - 2.0 * np.log((n - 1.0) / (n + 1.0)), gradient


def log_albedo(theta: Array) -> tuple[Array, Array]:
    """ln of the specular albedo, the mean of the channels: ∫ of the interface part, viewed along the normal."""
    value, gradient = _log_strength(theta)
    albedo, by_gamma, by_n, by_tail = albedo_per_strength(theta)
    for place, slope in ((LOG_GAMMA, by_gamma), (LOG_N1, by_n), (TAIL, by_tail)):
        gradient[:, place] = slope / albedo
    return value + np.log(albedo), gradient


def _log_strength(theta: Array) -> tuple[Array, Array]:
    """ln(β F₀), with the mean of the interface colour."""
    c, colour = channels_of(theta), interface_colour(theta)
    strength = np.maximum(theta[:, STRENGTH], SMALLEST)
    gradient = np.zeros_like(theta)
    gradient[:, STRENGTH] = 1.0 / strength
    gradient[:, colour_slice(c)] = colour / colour.sum(axis=1, keepdims=True) @ contrasts(c)
    return np.log(strength) + np.log(colour.mean(axis=1)), gradient


def albedo_per_strength(theta: Array) -> tuple[Array, Array, Array, Array]:
    """∫ f dL viewed along the normal for β F₀ = 1 and a neutral interface, and its derivatives: four (K,).

    They are by ln γ, ln(n − 1) and 1/ν. It is the value of a point under uniform light: a lamp at every node of a
    quadrature over φ = θ_L/2, with the solid angle of the node as its irradiance. The nodes are even in asinh(φ/φ₀),
    with φ₀ narrower than any lobe, so that lobes and tails of any width are resolved.
    """
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    edges = np.arcsinh(np.array([0.0, np.pi / 6, np.pi / 4]) / NARROWEST)  # G has a kink at θ_L = 60°
    half = np.diff(edges)[:, None] / 2
    place = (edges[:-1, None] + half + half * nodes).ravel()[None]
    angle = NARROWEST * np.sinh(place)
    solid = 4 * np.pi * np.sin(2 * angle) * NARROWEST * np.cosh(place) * (half * weights).ravel()
    cosines = Cosines(np.cos(2 * angle), np.ones_like(angle), np.cos(angle), np.cos(angle))
    lobe = Sight(cosines, solid[:, :, None]).lobe(theta[:, LOG_GAMMA], theta[:, LOG_N1], theta[:, TAIL], True)
    albedo, by_gamma, by_n, by_tail = (part[:, 0, 0] for part in lobe)
    return albedo, by_gamma, by_n, by_tail
