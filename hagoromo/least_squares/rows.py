"""Rows: K dense fits of P parameters each, within bounds, as a problem of the driver."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.least_squares.fit_status import FitStatus, Status

Array = NDArray[np.float64]

SMALLEST_CURVATURE = 1e-300  # a coordinate of less curvature has no effect on the cost


class RowsState(NamedTuple):
    """K rows of P parameters: theta (K, P), cost (K,), gradient (K, P), curvature (K, P, P) = JᵀWJ."""

    theta: Array
    cost: Array
    gradient: Array
    curvature: Array


@dataclass(frozen=True, eq=False)
class RowsProblem:
    """K dense fits of P parameters each, within bounds, with Marquardt's scaling.

    evaluate: rows theta (K, P) → cost (K,), gradient (K, P) and Gauss–Newton curvature (K, P, P). lower, upper: (P,)
    bounds. free: (P,) parameters that are fitted; the others stay.
    """

    evaluate: Callable[[Array], tuple[Array, Array, Array]]
    lower: Array
    upper: Array
    free: NDArray[np.bool_]

    def start(self, theta: Array) -> RowsState:
        """The state at rows `theta` (K, P), brought within the bounds."""
        theta = np.clip(theta, self.lower, self.upper)
        return RowsState(theta, *self.evaluate(theta))

    def cost(self, state: RowsState) -> Array:
        """(K,)"""
        return state.cost

    def decrement(self, state: RowsState, moving: NDArray[np.bool_]) -> Array:
        """(K,) Newton's decrement gᵀH⁻¹g/2 over what is free and not held at a bound."""
        fits = np.flatnonzero(moving)
        _, g, h, identity = self._scaled(state, fits)
        newton = np.linalg.solve(h + 1e-12 * identity, g[..., None])[..., 0]
        decrement = np.full(len(moving), np.inf)
        decrement[fits] = 0.5 * np.abs(np.einsum("kp,kp->k", g, newton))
        return decrement

    def trial(self, state: RowsState, damping: Array, moving: NDArray[np.bool_]) -> tuple[RowsState, Array]:
        """The state after one damped step of the rows that are moving, projected to the bounds."""
        fits = np.flatnonzero(moving)
        scale, g, h, identity = self._scaled(state, fits)
        step = -np.linalg.solve(h + damping[fits, None, None] * identity, g[..., None])[..., 0] * scale
        tried = np.clip(state.theta[fits] + step, self.lower, self.upper)
        trial, length = RowsState(*(part.copy() for part in state)), np.zeros(len(moving))
        length[fits] = np.linalg.norm(tried - state.theta[fits], axis=1)
        for part, new in zip(trial, (tried, *self.evaluate(tried)), strict=True):
            part[fits] = new
        return trial, length

    def chosen(self, better: NDArray[np.bool_], trial: RowsState, state: RowsState) -> RowsState:
        """Of each row the better one."""
        pairs = zip(trial, state, strict=True)
        return RowsState(*(np.where(better.reshape(-1, *[1] * (new.ndim - 1)), new, old) for new, old in pairs))

    def gradient(self, state: RowsState) -> Array:
        """(K,) over what is free and not held at a bound."""
        return np.linalg.norm(np.where(self._held(state.theta, state.gradient), 0.0, state.gradient), axis=1)

    def _held(self, theta: Array, gradient: Array) -> NDArray[np.bool_]:
        outwards = ((theta <= self.lower) & (gradient > 0)) | ((theta >= self.upper) & (gradient < 0))
        return ~self.free | outwards

    def _scaled(self, state: RowsState, fits: NDArray[np.intp]) -> tuple[Array, Array, Array, Array]:
        """Scale (k, P), gradient and curvature of rows `fits`, of unit diagonal; what is held has gradient 0."""
        theta, gradient, curvature = state.theta[fits], state.gradient[fits], state.curvature[fits]
        held = self._held(theta, gradient)
        g = np.where(held, 0.0, gradient)
        h = np.where(held[:, :, None] | held[:, None, :], 0.0, curvature)
        diagonal = np.einsum("kpp->kp", h).copy()
        flat = diagonal <= SMALLEST_CURVATURE  # nothing depends on it here (as γ and n where β = 0): it stays
        scale = 1.0 / np.sqrt(np.where(flat, 1.0, diagonal))
        g = np.where(flat, 0.0, g) * scale
        h = h * scale[:, :, None] * scale[:, None, :]
        identity = np.eye(theta.shape[1])
        return scale, g, np.where(identity.astype(bool), 1.0, h), identity


def reweighted(
    solve: Callable[[Array], tuple[Array, Array]],
    reweigh: Callable[[Array], Array],
    weight: Array,
    rounds: int,
    tolerance: float,
) -> tuple[Array, Array, FitStatus]:
    """Iteratively reweighted least squares (Holland & Welsch 1977): estimate, weights and how the rounds ended.

    solve: weights → estimate and residuals. reweigh: residuals → weights. All `rounds` are done; they have converged
    when the last one changed the estimate by less than `tolerance` of its norm. The weights are those of the last
    residuals.
    """
    estimate, change = np.zeros(0), np.inf
    for _ in range(rounds):
        last = estimate
        estimate, residuals = solve(weight)
        weight = reweigh(residuals)
        if last.shape == estimate.shape:
            change = float(np.linalg.norm(estimate - last) / max(float(np.linalg.norm(estimate)), SMALLEST_CURVATURE))
    status = Status.CONVERGED if change < tolerance else Status.OUT_OF_STEPS
    return estimate, weight, FitStatus(status, rounds, last_step=change)
