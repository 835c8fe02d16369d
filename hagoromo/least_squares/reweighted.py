"""Reweighted: iteratively reweighted least squares."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from hagoromo.least_squares.fit_status import FitStatus, Status
from hagoromo.least_squares.rows import SMALLEST_CURVATURE

Array = NDArray[np.float64]


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
