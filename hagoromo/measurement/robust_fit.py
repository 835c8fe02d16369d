"""Robust least squares of eq. (2)–(6) on observed values: Levenberg–Marquardt for many starting points at once.

Enters: `Observations` of one material and rows of coordinates θ = (α c_b per channel, β F₀, ln γ, ln(n − 1)), with
F₀ = F(0, n): β alone would have to follow n along a bent valley. Leaves: rows at their minimum. Each row is an own
fit, so starts and points of a profile share every kernel.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hagoromo.least_squares import Damping, FitStatuses, Loss, RowsProblem, Tolerance, levenberg_marquardt
from hagoromo.measurement.observations import Observations
from hagoromo.measurement.sight import Array

GAMMA_RANGE = (0.01, 1.2)  # [rad] admissible: narrower than a pixel of a sphere sees, wider than a second Lambert lobe
N_RANGE = (1.05, 3.0)  # admissible refractive index: above a gas, up to the densest dielectrics
SMALLEST_DECREMENT = 1e-6  # a row has converged when one more step would lower Σρ by less: 0.1 % of a standard error
MATERIAL_FIT_STEPS = 60  # of one row


@dataclass(frozen=True, eq=False)
class Rows:
    """K fits: coordinates theta (K, C+3), cost (K,) = Σρ, curvature (K, C+3, C+3) = JᵀWJ, and how each ended."""

    theta: Array
    cost: Array
    curvature: Array
    statuses: FitStatuses


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


def minimise(objective: Objective, theta: Array, free: NDArray[np.bool_], steps: int = MATERIAL_FIT_STEPS) -> Rows:
    """Rows theta (K, P) moved to their nearest minimum; coordinates where `free` (P,) is false stay.

    β F₀ stays 0 or more, ln γ and ln(n − 1) in their admissible range. A row that has not converged after `steps` steps
    says so in `Rows.statuses`.
    """
    problem = RowsProblem(objective.at, *_bounds(theta.shape[1]), free)
    tolerance = Tolerance(decrement=SMALLEST_DECREMENT)
    found = levenberg_marquardt(problem, problem.start(theta), Damping(), tolerance, steps)
    return Rows(found.state.theta, found.state.cost, found.state.curvature, found.statuses)


def at_bound(theta: Array) -> NDArray[np.bool_]:
    """(P,) where a coordinate has come to the end of its admissible range."""
    low, high = _bounds(theta.shape[-1])
    return (theta <= low) | (theta >= high)


def _bounds(size: int) -> tuple[Array, Array]:
    low, high = np.full(size, -np.inf), np.full(size, np.inf)
    low[-3] = 0.0
    low[-2:], high[-2:] = np.log([(GAMMA_RANGE[0], N_RANGE[0] - 1), (GAMMA_RANGE[1], N_RANGE[1] - 1)])
    return low, high
