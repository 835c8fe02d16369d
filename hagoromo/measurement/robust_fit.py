"""Robust least squares of eq. (2)–(6) on observed values: Levenberg–Marquardt for many starting points at once.

Enters: `Observations` of one material and rows of parameters θ = (α c_b per channel, β F₀, ln γ, ln(n − 1)), with
F₀ = F(0, n), since β itself is strongly correlated with n. Leaves: rows at their minimum. Each row is a fit of its
own, so that all starts, and all points of a profile, share every kernel.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hagoromo.least_squares import Damping, FitStatuses, Loss, RowsProblem, Tolerance, levenberg_marquardt
from hagoromo.measurement.observations import Observations
from hagoromo.measurement.sight import Array

GAMMA_RANGE = (0.01, 1.2)  # [rad] admissible: below, a sphere's pixel is wider than the lobe; above, it is diffuse
N_RANGE = (1.05, 3.0)  # admissible refractive index: above a gas, up to the densest dielectrics
SMALLEST_DECREMENT = 1e-6  # of Σρ: a row whose next step would lower it by less has converged (0.1 % of an error)
MATERIAL_FIT_STEPS = 60  # largest number of steps of one row


@dataclass(frozen=True, eq=False)
class Rows:
    """K fits: parameters theta (K, C+3), cost (K,) = Σρ, curvature (K, C+3, C+3) = JᵀWJ, and how each ended."""

    theta: Array
    cost: Array
    curvature: Array
    statuses: FitStatuses


@dataclass(frozen=True, eq=False)
class Objective:
    """The cost: Σρ of the residuals of `observations` over √variance, or with frozen `weights` Σ w r²/2.

    variance: (N, C) of the values. weights: (N, C) or None.
    """

    observations: Observations
    variance: Array
    loss: Loss
    weights: Array | None = None

    def evaluate(self, theta: Array) -> tuple[Array, Array, Array]:
        """Cost (K,), gradient (K, P) and Gauss–Newton curvature (K, P, P) at rows theta (K, P)."""
        c = self.observations.channels
        body = self.observations.sight.body
        s, by_gamma, by_n = self.observations.sight.interface(theta[:, -2], theta[:, -1])
        strength = theta[:, c, None, None]
        deviation = self.observations.values - theta[:, None, :c] * body - strength * s
        r = deviation / np.sqrt(self.variance)
        known = self.observations.used
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
    """Rows theta (K, P) moved to their nearest minimum; parameters where `free` (P,) is false stay fixed.

    β F₀ stays 0 or more, ln γ and ln(n − 1) in their admissible range. `Rows.statuses` states which rows had not
    converged after `steps` steps.
    """
    problem = RowsProblem(objective.evaluate, *_bounds(theta.shape[1]), free)
    tolerance = Tolerance(decrement=SMALLEST_DECREMENT)
    solution = levenberg_marquardt(problem, problem.start(theta), Damping(), tolerance, steps)
    return Rows(solution.state.theta, solution.state.cost, solution.state.curvature, solution.statuses)


def at_bound(theta: Array) -> NDArray[np.bool_]:
    """(P,) where a parameter is at a limit of its admissible range."""
    low, high = _bounds(theta.shape[-1])
    return (theta <= low) | (theta >= high)


def _bounds(size: int) -> tuple[Array, Array]:
    low, high = np.full(size, -np.inf), np.full(size, np.inf)
    low[-3] = 0.0
    low[-2:], high[-2:] = np.log([(GAMMA_RANGE[0], N_RANGE[0] - 1), (GAMMA_RANGE[1], N_RANGE[1] - 1)])
    return low, high
