"""Intervals where no interface reflection was detected: bounds on a lobe that the noise may still hide.

A wide lobe below the noise looks like a brighter body. So body and lobe are evaluated together on a grid of facet
widths, refractive indices and strengths βF₀ ≥ 0; a value of a quantity q belongs to the 95 % interval when for some of
them Δχ² + (q − q̂)²/var(q) ≤ 3.84 κ, as in `interval`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hagoromo.measurement.material.interval import CHI_SQUARE_95, inflation
from hagoromo.measurement.material.quantity import Quantity, albedo_per_strength, alpha
from hagoromo.measurement.material.sandwich import MaterialFit
from hagoromo.measurement.parameters import GAMMA_RANGE, LOG_GAMMA, LOG_N1, N_RANGE, STRENGTH, channels_of
from hagoromo.measurement.sight import Array

WIDTHS = np.geomspace(0.01, GAMMA_RANGE[1], 16)  # γ [rad] of the grid; narrower lobes would fall between pixels
INDICES = (N_RANGE[0], 1.3, 1.5, 1.9, 3.0, N_RANGE[1])  # n of the grid
STRENGTHS = 24  # β F₀ of the grid, from 0 to the largest possible
FARTHEST = 3.0  # standard errors above the best strength


@dataclass(frozen=True, eq=False)
class Sweep:
    """K lobes, each with its best body: theta (K, P), rest (K,) Δχ², covariance (K, P, P) of the body."""

    fit: MaterialFit
    theta: Array
    rest: Array
    covariance: Array


def sweep_of_gloss(fit: MaterialFit, n: float | None = None) -> Sweep:
    """All lobes that the noise allows in addition to the matte `fit`; n: refractive index, if known."""
    c, place = channels_of(fit.theta), len(fit.theta) + STRENGTH
    grid = np.array([(width, index) for width in WIDTHS for index in (INDICES if n is None else (n,))])
    start = np.tile(fit.theta, (len(grid), 1))
    start[:, STRENGTH] = 0.0
    start[:, LOG_GAMMA], start[:, LOG_N1] = np.log(grid[:, 0]), np.log(grid[:, 1] - 1.0)
    cost, gradient, curvature = fit.objective.evaluate(start)  # quadratic in body and strength: the weights are frozen
    body, across, along = curvature[:, :c, :c], curvature[:, :c, place], curvature[:, place, place]
    inverse = np.linalg.inv(body)
    tilt = np.einsum("kpq,kq->kp", inverse, across)  # fall of the body per unit of strength
    own = np.maximum(along - np.einsum("kp,kp->k", across, tilt), 1e-12 * np.maximum(along, 1e-300))
    rhs = gradient[:, place] - np.einsum("kp,kp->k", tilt, gradient[:, :c])
    best, spread = -rhs / own, 1.0 / np.sqrt(own)
    # no lobe may reflect more than it receives
    ceiling = 1.0 / albedo_per_strength(start)[0]
    most = np.minimum(np.maximum(best, 0.0) + FARTHEST * np.sqrt(inflation(fit, alpha)) * spread, ceiling)
    strength = np.linspace(0.0, 1.0, STRENGTHS)[:, None] * most
    fall = 0.5 * own * ((strength - best) ** 2 - best**2)
    base = np.einsum("kpq,kq->kp", inverse, gradient[:, :c])
    theta = np.tile(start, (STRENGTHS, 1, 1))
    theta[..., :c] -= base + strength[..., None] * tilt
    theta[..., place] = strength
    value = cost - 0.5 * np.einsum("kp,kp->k", base, gradient[:, :c]) + fall
    covariance = np.zeros((*theta.shape, theta.shape[2]))
    covariance[..., :c, :c] = inverse
    size = theta.shape[-1]
    rows = theta.reshape(-1, size)
    return Sweep(fit, rows, 2.0 * (value - value.min()).ravel(), covariance.reshape(len(rows), size, size))


def swept_interval(sweep: Sweep, quantity: Quantity) -> tuple[float, float]:
    """95 % interval of `quantity`."""
    values, gradients = quantity(sweep.theta)
    limit = CHI_SQUARE_95 * inflation(sweep.fit, alpha)
    inside = sweep.rest <= limit
    spread = np.sqrt(np.einsum("kp,kpq,kq->k", gradients, sweep.covariance, gradients))
    reach = (spread * np.sqrt(np.maximum(limit - sweep.rest, 0.0)))[inside]
    return float(np.min(values[inside] - reach)), float(np.max(values[inside] + reach))


def albedo(theta: Array) -> tuple[Array, Array]:
    """The specular albedo, for lobes of any strength from 0 on; it does not depend on the body."""
    return theta[:, STRENGTH] * albedo_per_strength(theta)[0], np.zeros_like(theta)
