"""Quantities of a material as functions of the parameters θ = (α c_b per channel, β F₀, ln γ, ln(n − 1)) of its fit.

Each takes rows θ (K, P) and gives its values (K,) with their gradients (K, P). F₀ = F(0, n) = ((n − 1)/(n + 1))².
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from hagoromo.measurement.sight import Array, Sight
from hagoromo.reflectance.torrance_sparrow import Cosines

Quantity = Callable[[Array], tuple[Array, Array]]

SMALLEST = 1e-12  # [1/sr] smallest β F₀ whose logarithm is taken


def pack_theta(alpha_body: Array, beta: float, gamma: float, n: float) -> Array:
    """Parameters θ (P,) of a material; alpha_body: α c_b per channel."""
    return np.array([*alpha_body, beta * ((n - 1.0) / (n + 1.0)) ** 2, np.log(gamma), np.log(n - 1.0)])


def unpack_theta(theta: Array) -> tuple[Array, float, float, float]:
    """α c_b per channel, β, γ [rad] and n of parameters θ (P,): the inverse of `pack_theta`."""
    n = 1.0 + math.exp(theta[-1])
    return theta[:-3], float(theta[-3]) * ((n + 1.0) / (n - 1.0)) ** 2, math.exp(theta[-2]), n


def coordinate(index: int) -> Quantity:
    """The quantity θ[index] itself."""

    def quantity(theta: Array) -> tuple[Array, Array]:
        return theta[:, index], np.broadcast_to(np.eye(theta.shape[1])[index], theta.shape)

    return quantity


def alpha(theta: Array) -> tuple[Array, Array]:
    """α: the mean of α c_b over the channels, as body colours have mean 1."""
    c = theta.shape[1] - 3
    return theta[:, :c].mean(axis=1), np.broadcast_to(np.r_[np.full(c, 1.0 / c), 0.0, 0.0, 0.0], theta.shape)


def body_colour(channel: int) -> Quantity:
    """The quantity c_b of a channel."""

    def quantity(theta: Array) -> tuple[Array, Array]:
        c = theta.shape[1] - 3
        alpha = theta[:, :c].mean(axis=1)
        value, gradient = theta[:, channel] / alpha, np.zeros_like(theta)
        gradient[:, :c] = (np.eye(c)[channel] - value[:, None] / c) / alpha[:, None]
        return value, gradient

    return quantity


def log_beta(theta: Array) -> tuple[Array, Array]:
    """ln β."""
    value, gradient = _log_strength(theta)
    n = 1.0 + np.exp(theta[:, -1])
    gradient[:, -1] = -4.0 / (n + 1.0)
    return value - 2.0 * np.log((n - 1.0) / (n + 1.0)), gradient


def log_albedo(theta: Array) -> tuple[Array, Array]:
    """ln of the specular albedo: ∫ of the interface part over all lamp directions, viewed along the normal."""
    value, gradient = _log_strength(theta)
    albedo, by_gamma, by_n = albedo_per_strength(theta)
    gradient[:, -2], gradient[:, -1] = by_gamma / albedo, by_n / albedo
    return value + np.log(albedo), gradient


def _log_strength(theta: Array) -> tuple[Array, Array]:
    """ln(β F₀)."""
    strength = np.maximum(theta[:, -3], SMALLEST)
    gradient = np.zeros_like(theta)
    gradient[:, -3] = 1.0 / strength
    return np.log(strength), gradient


def albedo_per_strength(theta: Array) -> tuple[Array, Array, Array]:
    """∫ f dL viewed along the normal for β F₀ = 1, and its derivatives by ln γ and ln(n − 1): three (K,).

    It is the value of a point under uniform light: a lamp at every node of a quadrature over θ_L, with the solid angle
    of the node as its irradiance.
    """
    nodes, weights = np.polynomial.legendre.leggauss(32)
    edges = np.array([0.0, np.pi / 12, np.pi / 3, np.pi / 2])  # G has a kink at 60°, narrow lobes end within 15°
    half = np.diff(edges)[:, None] / 2
    angle = (edges[:-1, None] + half + half * nodes).ravel()[None]
    solid = 2 * np.pi * np.sin(angle) * (half * weights).ravel()
    cosines = Cosines(np.cos(angle), np.ones_like(angle), np.cos(angle / 2), np.cos(angle / 2))
    albedo, by_gamma, by_n = Sight(cosines, solid[:, :, None]).interface(theta[:, -2], theta[:, -1])
    return albedo[:, 0, 0], by_gamma[:, 0, 0], by_n[:, 0, 0]
