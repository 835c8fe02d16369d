"""Robust least squares of eq. (2)–(6) on observed values: Levenberg–Marquardt for many starting points at once.

Enters: `Observations` of one material and rows of coordinates θ = (α c_b per channel, β F₀, ln γ, ln(n − 1)), with
F₀ = F(0, n): β alone would have to follow n along a bent valley. Leaves: rows at their minimum. Each row is an own
fit, so starts and points of a profile share every kernel.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hagoromo.measurement.observations import Observations
from hagoromo.measurement.sight import Array

GAMMA_RANGE = (0.01, 1.2)  # [rad] admissible: narrower than a pixel of a sphere sees, wider than a second Lambert lobe
N_RANGE = (1.05, 3.0)  # admissible refractive index: above a gas, up to the densest dielectrics
HUBER = 1.345  # 95 % efficient under normal noise (Huber 1981)
BIWEIGHT = 6.0  # 98 % efficient under normal noise, forgets what lies beyond 6σ (Mosteller & Tukey 1977)
DECREMENT = 1e-6  # a row has converged when one more step would lower Σρ by less: 0.1 % of a standard error
STEPS = 60


@dataclass(frozen=True)
class Loss:
    """ρ(r) of a residual in standard deviations: Huber's (convex, to get there) or Tukey's biweight."""

    biweight: bool = False

    def value(self, r: Array) -> Array:
        """ρ(r); r²/2 near 0."""
        if self.biweight:
            return BIWEIGHT**2 / 6 * (1.0 - np.maximum(1.0 - (r / BIWEIGHT) ** 2, 0.0) ** 3)
        size = np.abs(r)
        return np.where(size <= HUBER, 0.5 * r * r, HUBER * (size - 0.5 * HUBER))

    def weight(self, r: Array) -> Array:
        """ρ'(r)/r."""
        if self.biweight:
            return np.maximum(1.0 - (r / BIWEIGHT) ** 2, 0.0) ** 2
        return HUBER / np.maximum(np.abs(r), HUBER)

    def curvature(self, r: Array) -> Array:
        """ρ''(r)."""
        if self.biweight:
            t = (r / BIWEIGHT) ** 2
            return np.where(t < 1.0, (1.0 - t) * (1.0 - 5.0 * t), 0.0)
        return (np.abs(r) <= HUBER).astype(np.float64)


@dataclass(frozen=True, eq=False)
class Rows:
    """K fits: coordinates theta (K, C+3), cost (K,) = Σρ, curvature (K, C+3, C+3) = JᵀWJ, converged (K,)."""

    theta: Array
    cost: Array
    curvature: Array
    converged: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Objective:
    """What is minimised: Σρ of the residuals of `seen` over √variance, or with `weights` Σ w r²/2, frozen.

    variance: (N, C) of the values. weights: (N, C) or None.
    """

    seen: Observations
    variance: Array
    loss: Loss
    weights: Array | None = None

    def at(self, theta: Array) -> tuple[Array, Array, Array]:
        """Cost (K,), gradient (K, P) and Gauss–Newton curvature (K, P, P) at rows theta (K, P)."""
        c = self.seen.channels
        body = self.seen.sight.body
        s, by_gamma, by_n = self.seen.sight.interface(theta[:, -2], theta[:, -1])
        strength = theta[:, c, None, None]
        deviation = self.seen.values - theta[:, None, :c] * body - strength * s
        r = deviation / np.sqrt(self.variance)
        known = self.seen.used
        if self.weights is None:
            cost = np.sum(np.where(known, self.loss.value(r), 0.0), axis=(1, 2))
            weight = np.where(known, self.loss.weight(r), 0.0) / self.variance
        else:
            weight = np.broadcast_to(np.where(known, self.weights, 0.0) / self.variance, r.shape)
            cost = 0.5 * np.sum(weight * deviation**2, axis=(1, 2))
        shared = (s, strength * by_gamma, strength * by_n)  # derivatives by β F₀, ln γ, ln(n − 1)
        gradient = np.empty_like(theta)
        curvature = np.zeros((*theta.shape, theta.shape[1]))
        gradient[:, :c] = -np.einsum("knc,nc,knc->kc", weight, body, deviation)
        curvature[:, range(c), range(c)] = np.einsum("knc,nc->kc", weight, body**2)
        for i, column in enumerate(shared, c):
            weighted = weight * column
            gradient[:, i] = -np.einsum("knc,knc->k", weighted, deviation)
            curvature[:, :c, i] = curvature[:, i, :c] = np.einsum("knc,nc->kc", weighted, body)
            for j, other in enumerate(shared[: i - c + 1], c):
                curvature[:, i, j] = curvature[:, j, i] = np.einsum("knc,knc->k", weighted, other)
        return cost, gradient, curvature


def minimise(objective: Objective, theta: Array, free: NDArray[np.bool_], steps: int = STEPS) -> Rows:
    """Rows theta (K, P) moved to their nearest minimum; coordinates where `free` (P,) is false stay.

    Levenberg–Marquardt with Marquardt's scaling; β F₀ stays 0 or more, ln γ and ln(n − 1) in their admissible range. A
    row that has not converged after `steps` steps says so in `Rows.converged`.
    """
    theta = _admissible(theta)
    cost, gradient, curvature = objective.at(theta)
    damping = np.full(len(theta), 1e-3)
    converged = np.zeros(len(theta), bool)
    for _ in range(steps):
        rows = np.flatnonzero(~converged)
        step, decrement = _step(theta[rows], gradient[rows], curvature[rows], damping[rows], free)
        settled = decrement < DECREMENT
        converged[rows[settled]] = True
        rows, step = rows[~settled], step[~settled]
        if not rows.size:
            break
        trial = _admissible(theta[rows] + step)
        trial_cost, trial_gradient, trial_curvature = objective.at(trial)
        better = trial_cost <= cost[rows]
        taken = rows[better]
        theta[taken], cost[taken] = trial[better], trial_cost[better]
        gradient[taken], curvature[taken] = trial_gradient[better], trial_curvature[better]
        damping[rows] = np.where(better, np.maximum(damping[rows] / 10, 1e-9), np.minimum(damping[rows] * 10, 1e9))
    return Rows(theta, cost, curvature, converged)


def at_bound(theta: Array) -> NDArray[np.bool_]:
    """(P,) where a coordinate has come to the end of its admissible range."""
    low, high = _bounds(theta.shape[-1])
    return (theta <= low) | (theta >= high)


def _step(
    theta: Array, gradient: Array, curvature: Array, damping: Array, free: NDArray[np.bool_]
) -> tuple[Array, Array]:
    """Damped step and the undamped Newton decrement gᵀH⁻¹g/2, for coordinates that are free and not held at a bound."""
    low, high = _bounds(theta.shape[1])
    held = ~free | ((theta <= low) & (gradient > 0)) | ((theta >= high) & (gradient < 0))
    g = np.where(held, 0.0, gradient)
    h = np.where(held[:, :, None] | held[:, None, :], 0.0, curvature)
    diagonal = np.einsum("kpp->kp", h).copy()
    flat = diagonal <= 1e-300  # nothing depends on it here (as γ and n where β = 0): it stays
    scale = 1.0 / np.sqrt(np.where(flat, 1.0, diagonal))
    g = np.where(flat, 0.0, g) * scale
    h = h * scale[:, :, None] * scale[:, None, :]
    identity = np.eye(theta.shape[1])
    h = np.where(identity.astype(bool), 1.0, h)
    newton = np.linalg.solve(h + 1e-12 * identity, g[..., None])[..., 0]
    step = -np.linalg.solve(h + damping[:, None, None] * identity, g[..., None])[..., 0] * scale
    return step, 0.5 * np.abs(np.einsum("kp,kp->k", g, newton))


def _bounds(size: int) -> tuple[Array, Array]:
    low, high = np.full(size, -np.inf), np.full(size, np.inf)
    low[-3] = 0.0
    low[-2:], high[-2:] = np.log([(GAMMA_RANGE[0], N_RANGE[0] - 1), (GAMMA_RANGE[1], N_RANGE[1] - 1)])
    return low, high


def _admissible(theta: Array) -> Array:
    return np.clip(theta, *_bounds(theta.shape[1]))
