"""Fit of one material: variance-weighted robust least squares for α c_b, β, γ, n.

Weights and variances follow from each other and from the model, so they are repeated until the estimate stands still.
Coordinates θ = (α c_b per channel, β F₀, ln γ, ln(n − 1)), as in `robust_fit`.
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

START_GAMMA = np.geomspace(0.03, 0.7, 8)  # [rad] a lobe off by less than 1.3 in width keeps its overlap with the data
START_N = (1.2, 1.7)
START_RANKING_STEPS = 6  # the linear fits at the starts are only compared, not kept
MATERIAL_FIT_ROUNDS = 30
LOSS_ROUNDS = 6  # rounds after which the loss stays what it is and no value returns
MODEL_ERROR_ROUNDS = 15  # rounds after which the model error stays what it is, too
STANDSTILL = 0.01  # change of the estimate in a round, in standard errors
LACK = 1.2  # robust scale beyond which the model lacks: 10 % of gross outliers would raise it to 1.14 only
SATURATION_MARGIN = 4.0  # standard deviations below the ceiling
LOG_MODEL_ERROR = (np.log(1e-6), np.log(10.0))  # range searched, relative


def fit_material(seen: Observations, n: float | None = None, with_interface: bool = True) -> MaterialFit:
    """α c_b, β, γ and n of one material; n is kept where given, β = 0 without `with_interface`.

    Huber's loss finds the estimate. Where the residuals are then what the noise allows, Tukey's biweight takes over:
    what remains beyond 6σ is no reflection of this kind (cast shadow, dust). Where they are not, large residuals may be
    the model's own, so none is thrown away: Huber's loss stays, and a relative model error joins the variance.
    Raises `InputError` when there are too few values or the rounds do not come to a standstill.
    """
    free = np.ones(seen.channels + 3, bool)
    free[-1] = n is None and with_interface
    free[-3:-1] = with_interface
    if np.sum(seen.used) < 10 * free.sum():
        raise InputError(f"{np.sum(seen.used)} usable values cannot tell {free.sum()} parameters: give more pixels")
    theta = _start(seen, n, free) if with_interface else _matte_start(seen, n)
    usable, lacks, model_error, change = seen.used, False, 0.0, np.inf
    signal = np.abs(expected(seen.sight, theta))
    for turn in range(MATERIAL_FIT_ROUNDS):
        model = expected(seen.sight, theta)
        # decided anew in the first rounds only: a choice between two near equals could otherwise go on for ever
        usable = usable if turn < LOSS_ROUNDS else seen.used
        seen = replace(seen, used=usable & _below_ceiling(seen, model))
        scale = _scale(seen, model)
        lacks = scale > LACK if turn < LOSS_ROUNDS else lacks
        if turn < MODEL_ERROR_ROUNDS:
            # the middle of all rounds: a lobe and the variance that follows it could chase each other for ever
            signal = np.sqrt(signal * np.abs(model))
            model_error = _model_error(seen, model, signal) if lacks else 0.0
        variance = seen.variance_at(model) + (model_error * signal) ** 2
        objective = MaterialObjective(seen, variance, HUBER if lacks else TUKEY)
        rows = minimise(objective, theta[None], free)
        moved = (rows.theta[0] - theta)[free]
        theta = rows.theta[0]
        change = float(moved @ rows.curvature[0][np.ix_(free, free)] @ moved) ** 0.5
        if standstill(rows, change, STANDSTILL):
            return with_covariance(objective, theta, free, scale, model_error, status_of(rows, turn + 1, change))
    raise InputError(
        f"the fit still moves by {change:.2g} standard errors after {MATERIAL_FIT_ROUNDS} rounds: mask pixels that "
        "this reflectance cannot explain, or give more photographs"
    )


def standstill(rows: Rows, change: float, limit: float) -> bool:
    """Whether a round that moved its one row by `change` standard errors is the last: a tenth of `limit` if unsettled.

    Steps that rounding alone rejects never meet the test of convergence.
    """
    return change < (limit if rows.statuses.converged[0] else limit / 10.0)


def status_of(rows: Rows, rounds: int, change: float) -> FitStatus:
    """The status of rounds that came to a standstill, the last of which gave `rows`."""
    return replace(rows.statuses[0], status=Status.CONVERGED, steps=rounds, last_step=change)


def _start(seen: Observations, n: float | None, free: NDArray[np.bool_]) -> Array:
    """The best of several starts in γ and n, brought to its minimum under Huber's loss."""
    grid = np.array([(g, m) for g in START_GAMMA for m in (START_N if n is None else (n,))])
    matte = _matte_start(seen, n)
    theta = np.tile(matte, (len(grid), 1))
    theta[:, -2:] = np.log(grid - [0.0, 1.0])
    # where the model lacks, residuals of many standard deviations would make the loss a sum of absolute values
    scale = max(_scale(seen, expected(seen.sight, matte)), 1.0)
    objective = Objective(seen, scale**2 * seen.noise, HUBER)
    linear = np.arange(theta.shape[1]) <= seen.channels
    ranked = minimise(objective, theta, linear, START_RANKING_STEPS)
    rows = minimise(objective, ranked.theta[np.argsort(ranked.cost)[:3]], free)
    return rows.theta[np.argmin(rows.cost)]


def _matte_start(seen: Observations, n: float | None) -> Array:
    """Coordinates of the matte surface nearest by least squares."""
    body, weight = seen.sight.body, np.where(seen.used, 1.0 / seen.noise, 0.0)
    matte = np.sum(weight * body * seen.values, axis=0) / np.maximum(np.sum(weight * body**2, axis=0), 1e-300)
    middle = np.sqrt(START_GAMMA[0] * START_GAMMA[-1])
    return np.array([*matte, 0.0, np.log(middle), np.log((n or 1.5) - 1.0)])


def _below_ceiling(seen: Observations, model: Array) -> NDArray[np.bool_]:
    """What would not saturate: judged by the model, since the noise itself decides which values near the ceiling do."""
    return model + SATURATION_MARGIN * np.sqrt(seen.variance_at(model)) < seen.ceiling


def _scale(seen: Observations, model: Array) -> float:
    """Robust standard deviation of the residuals, in stated standard deviations."""
    squared = (seen.values - model) ** 2 / seen.variance_at(model)
    return float(np.sqrt(np.median(squared[seen.used]) / NORMAL_MEDIAN))


def _model_error(seen: Observations, model: Array, signal: Array) -> float:
    """Error of the model, relative to `signal`, that with the noise gives squared residuals a normal one's median."""
    used = seen.used
    squared, noise, power = ((seen.values - model)[used]) ** 2, seen.variance_at(model)[used], signal[used] ** 2

    def excess(log_error: float) -> float:
        return float(np.median(squared / (noise + np.exp(2 * log_error) * power))) - NORMAL_MEDIAN

    low, high = LOG_MODEL_ERROR
    if excess(low) <= 0.0 or excess(high) >= 0.0:
        return float(np.exp(low if excess(low) <= 0.0 else high))
    return float(np.exp(root_scalar(excess, bracket=(low, high)).root))
