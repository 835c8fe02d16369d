"""Fit of one material: variance-weighted robust least squares for α c_b, β, γ, n.

Weights and variances depend on the model, so they are updated until the estimate no longer changes.
Parameters θ = (α c_b per channel, β F₀, ln γ, ln(n − 1)), as in `robust_fit`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import root_scalar

from hagoromo.errors import InputError
from hagoromo.least_squares import HUBER, NORMAL_MEDIAN, TUKEY, FitStatus, Status
from hagoromo.measurement.material.material_objective import MaterialObjective, expected
from hagoromo.measurement.material.sandwich import MaterialFit, with_covariance
from hagoromo.measurement.observations import Observations
from hagoromo.measurement.robust_fit import Objective, Rows, minimise
from hagoromo.measurement.sight import Array

START_GAMMA = np.geomspace(0.03, 0.7, 8)  # [rad] a start within a factor of 1.3 of the width overlaps with the data
START_N = (1.2, 1.7)
START_RANKING_STEPS = 6  # of the linear fits at the starts, which only rank them
MATERIAL_FIT_ROUNDS = 30
LOSS_ROUNDS = 6  # rounds after which the choice of the loss is final and no excluded value returns
MODEL_ERROR_ROUNDS = 15  # rounds after which the model error is final too
MATERIAL_FIT_STANDSTILL = 0.01  # change of the estimate in a round, in standard errors
INCOMPLETE_SCALE = 1.2  # robust scale above which the model is incomplete: 10 % of outliers would raise it only to 1.14
SATURATION_MARGIN = 4.0  # standard deviations below the ceiling
LOG_MODEL_ERROR = (np.log(1e-6), np.log(10.0))  # range of the search, relative


def fit_material(observations: Observations, n: float | None = None, with_interface: bool = True) -> MaterialFit:
    """α c_b, β, γ and n of one material; n is fixed if given, β = 0 without `with_interface`.

    Huber's loss gives the estimate. If the residuals are then as large as the noise, Tukey's biweight takes over: what
    remains beyond 6σ is not reflection of this kind (cast shadow, dust). If they are larger, they may be errors of the
    model, so no value is excluded: Huber's loss remains, and a relative model error is added to the variance.
    Raises `InputError` when there are too few values or the rounds do not converge.
    """
    free = np.ones(observations.channels + 3, bool)
    free[-1] = n is None and with_interface
    free[-3:-1] = with_interface
    if np.sum(observations.used) < 10 * free.sum():
        raise InputError(
            f"{np.sum(observations.used)} usable values for {free.sum()} parameters are too few: give more pixels"
        )
    theta = _start(observations, n, free) if with_interface else _matte_start(observations, n)
    usable, lacks, model_error, change = observations.used, False, 0.0, np.inf
    signal = np.abs(expected(observations.sight, theta))
    for turn in range(MATERIAL_FIT_ROUNDS):
        model = expected(observations.sight, theta)
        # updated in the first rounds only: a choice between two near equals could otherwise alternate for ever
        usable = usable if turn < LOSS_ROUNDS else observations.used
        observations = replace(observations, used=usable & _below_ceiling(observations, model))
        scale = _scale(observations, model)
        lacks = scale > INCOMPLETE_SCALE if turn < LOSS_ROUNDS else lacks
        if turn < MODEL_ERROR_ROUNDS:
            # geometric mean over the rounds: a lobe and the variance that follows it could otherwise alternate for ever
            signal = np.sqrt(signal * np.abs(model))
            model_error = _model_error(observations, model, signal) if lacks else 0.0
        variance = observations.variance_at(model) + (model_error * signal) ** 2
        objective = MaterialObjective(observations, variance, HUBER if lacks else TUKEY)
        rows = minimise(objective, theta[None], free)
        moved = (rows.theta[0] - theta)[free]
        theta = rows.theta[0]
        change = float(moved @ rows.curvature[0][np.ix_(free, free)] @ moved) ** 0.5
        if at_standstill(rows, change, MATERIAL_FIT_STANDSTILL):
            return with_covariance(objective, theta, free, scale, model_error, status_of(rows, turn + 1, change))
    raise InputError(
        f"the fit still moves by {change:.2g} standard errors after {MATERIAL_FIT_ROUNDS} rounds: mask pixels that "
        "this reflectance cannot explain, or give more photographs"
    )


def at_standstill(rows: Rows, change: float, limit: float) -> bool:
    """Whether a round with a change of `change` standard errors is the last; a tenth of `limit` if it is unconverged.

    A row whose steps are rejected for rounding alone never passes the test of convergence.
    """
    return change < (limit if rows.statuses.converged[0] else limit / 10.0)


def status_of(rows: Rows, rounds: int, change: float) -> FitStatus:
    """The status of rounds that have converged, the last of which gave `rows`."""
    return replace(rows.statuses[0], status=Status.CONVERGED, steps=rounds, last_step=change)


def _start(observations: Observations, n: float | None, free: NDArray[np.bool_]) -> Array:
    """The best of several starts in γ and n, moved to its minimum under Huber's loss."""
    grid = np.array([(g, m) for g in START_GAMMA for m in (START_N if n is None else (n,))])
    matte = _matte_start(observations, n)
    theta = np.tile(matte, (len(grid), 1))
    theta[:, -2:] = np.log(grid - [0.0, 1.0])
    # if the model is incomplete, residuals of many standard deviations would make the loss a sum of absolute values
    scale = max(_scale(observations, expected(observations.sight, matte)), 1.0)
    objective = Objective(observations, scale**2 * observations.noise, HUBER)
    linear = np.arange(theta.shape[1]) <= observations.channels
    ranked = minimise(objective, theta, linear, START_RANKING_STEPS)
    rows = minimise(objective, ranked.theta[np.argsort(ranked.cost)[:3]], free)
    return rows.theta[np.argmin(rows.cost)]


def _matte_start(observations: Observations, n: float | None) -> Array:
    """Parameters of the matte surface that fits best by least squares."""
    body, weight = observations.sight.body, np.where(observations.used, 1.0 / observations.noise, 0.0)
    matte = np.sum(weight * body * observations.values, axis=0) / np.maximum(np.sum(weight * body**2, axis=0), 1e-300)
    middle = np.sqrt(START_GAMMA[0] * START_GAMMA[-1])
    return np.array([*matte, 0.0, np.log(middle), np.log((n or 1.5) - 1.0)])


def _below_ceiling(observations: Observations, model: Array) -> NDArray[np.bool_]:
    """Values that would not saturate, judged by the model: judging noisy values near the ceiling would bias them."""
    return model + SATURATION_MARGIN * np.sqrt(observations.variance_at(model)) < observations.ceiling


def _scale(observations: Observations, model: Array) -> float:
    """Robust standard deviation of the residuals, in stated standard deviations."""
    squared = (observations.values - model) ** 2 / observations.variance_at(model)
    return float(np.sqrt(np.median(squared[observations.used]) / NORMAL_MEDIAN))


def _model_error(observations: Observations, model: Array, signal: Array) -> float:
    """Model error, relative to `signal`, for which the median of the squared residuals is that of a normal law."""
    used = observations.used
    squared, noise, power = (
        ((observations.values - model)[used]) ** 2,
        observations.variance_at(model)[used],
        signal[used] ** 2,
    )

    def excess(log_error: float) -> float:
        return float(np.median(squared / (noise + np.exp(2 * log_error) * power))) - NORMAL_MEDIAN

    low, high = LOG_MODEL_ERROR
    if excess(low) <= 0.0 or excess(high) >= 0.0:
        return float(np.exp(low if excess(low) <= 0.0 else high))
    return float(np.exp(root_scalar(excess, bracket=(low, high)).root))
