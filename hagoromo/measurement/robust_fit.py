"""Robust least squares of eq. (2)–(6) on observed values: Levenberg–Marquardt for many starting points at once.

Enters: `Observations` of one material and rows of `parameters` θ. Leaves: rows at their minimum. Each row is a fit of
its own, so that all starts, and all points of a profile, share every kernel.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hagoromo.least_squares.fit_status import FitStatuses
from hagoromo.least_squares.levenberg_marquardt import Damping, Tolerance, levenberg_marquardt
from hagoromo.least_squares.loss import Loss
from hagoromo.least_squares.rows import RowsProblem
from hagoromo.measurement.observations import Observations
from hagoromo.measurement.parameters import (
    LOG_GAMMA,
    LOG_N1,
    PLACES,
    STRENGTH,
    TAIL,
    channels_of,
    colour_slice,
    contrasts,
    interface_colour,
)
from hagoromo.measurement.sight import Array
from hagoromo.reflectance.parameters import ROWS

SMALLEST_DECREMENT = 1e-6  # of Σρ: a row whose next step would lower it by less has converged (0.1 % of an error)
STRONGEST_CONTRAST = 5.0  # largest number of the interface colour: channels that differ by a factor of 1000
MATERIAL_FIT_STEPS = 60  # largest number of steps of one row


@dataclass(frozen=True, eq=False)
class Rows:
    """K fits: parameters theta (K, P), cost (K,) = Σρ, curvature (K, P, P) = JᵀWJ, and how each ended."""

    theta: Array
    cost: Array
    curvature: Array
    statuses: FitStatuses


@dataclass(frozen=True, eq=False)
class Objective:
    """The cost: Σρ of the residuals of `observations` over √variance, or with frozen `weights` Σ w r²/2.

    variance: (N, C) of the values. weights: (N, C) or None. shaped: (P,) parameters of the interface colour and the
    tail that are estimated: the slopes by the others among them are not needed, and are 0.
    """

    observations: Observations
    variance: Array
    loss: Loss
    weights: Array | None = None
    shaped: tuple[int, ...] = ()

    def evaluate(self, theta: Array) -> tuple[Array, Array, Array]:
        """Cost (K,), gradient (K, P) and Gauss–Newton curvature (K, P, P) at rows theta (K, P)."""
        c = self.observations.channels
        body = self.observations.sight.body
        interface, shared = self.interface(theta)
        deviation = self.observations.values - theta[:, None, :c] * body - interface
        r = deviation / np.sqrt(self.variance)
        known = self.observations.used
        if self.weights is None:
            cost = np.sum(np.where(known, self.loss.value(r), 0.0), axis=(1, 2))
            weight = np.where(known, self.loss.weight(r), 0.0) / self.variance
        else:
            weight = np.broadcast_to(np.where(known, self.weights, 0.0) / self.variance, r.shape)
            cost = 0.5 * np.sum(weight * deviation**2, axis=(1, 2))
        gradient = np.zeros_like(theta)
        curvature = np.zeros((*theta.shape, theta.shape[1]))
        gradient[:, :c] = -np.einsum("knc,nc,knc->kc", weight, body, deviation)
        curvature[:, range(c), range(c)] = np.einsum("knc,nc->kc", weight, body**2)
        for k, (i, column) in enumerate(shared):
            weighted = weight * column
            gradient[:, i] = -np.einsum("knc,knc->k", weighted, deviation)
            curvature[:, :c, i] = curvature[:, i, :c] = np.einsum("knc,nc->kc", weighted, body)
            for j, other in shared[: k + 1]:
                curvature[:, i, j] = curvature[:, j, i] = np.einsum("knc,knc->k", weighted, other)
        return cost, gradient, curvature

    def interface(self, theta: Array) -> tuple[Array, list[tuple[int, Array]]]:
        """The interface (K, N, C) at rows theta (K, P); the slopes (K, N, C) by its parameters, with their places."""
        c, places = self.observations.channels, theta.shape[1]
        lobe = self.observations.sight.lobe(
            theta[:, LOG_GAMMA], theta[:, LOG_N1], theta[:, TAIL], places + TAIL in self.shaped
        )
        colour = interface_colour(theta)[:, None]
        strength = theta[:, STRENGTH, None, None] * colour
        value = strength * lobe.value
        slopes = [(i, value * contrasts(c)[:, i - c]) for i in self.shaped if i < places + TAIL]
        if places + TAIL in self.shaped:
            slopes.append((places + TAIL, strength * lobe.by_tail))
        slopes.append((places + STRENGTH, colour * lobe.value))
        slopes.append((places + LOG_GAMMA, strength * lobe.by_log_gamma))
        slopes.append((places + LOG_N1, strength * lobe.by_log_n1))
        return value, slopes


def minimise(objective: Objective, theta: Array, free: NDArray[np.bool_], steps: int = MATERIAL_FIT_STEPS) -> Rows:
    """Rows theta (K, P) moved to their nearest minimum; parameters where `free` (P,) is false stay fixed.

    The body and β F₀ stay 0 or more, the others in their admissible range. `Rows.statuses` states which rows had not
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
    low[: channels_of(low)] = 0.0
    colours = colour_slice(channels_of(low))
    low[colours], high[colours] = -STRONGEST_CONTRAST, STRONGEST_CONTRAST
    low[STRENGTH] = 0.0
    for key, place in PLACES.items():
        low[place], high[place] = ROWS[key].fit.bounds
    return low, high
