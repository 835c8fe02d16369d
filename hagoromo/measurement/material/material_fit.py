"""Fit of one material: variance-weighted robust least squares for α c_b, β, γ, n and, on request, ν and e.

Weights and variances depend on the model, so they are updated until the estimate no longer changes.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import root_scalar

from hagoromo.errors import InputError
from hagoromo.least_squares.fit_status import FitStatus, Status
from hagoromo.least_squares.loss import HUBER, NORMAL_MEDIAN, TUKEY, Loss
from hagoromo.measurement.material.material_objective import MaterialObjective, expected
from hagoromo.measurement.material.sandwich import MaterialFit, with_covariance
from hagoromo.measurement.observations import Observations
from hagoromo.measurement.parameters import LOG_GAMMA, LOG_N1, STRENGTH, TAIL, colour_slice
from hagoromo.measurement.robust_fit import Objective, Rows, minimise
from hagoromo.measurement.sight import Array

START_GAMMA = np.geomspace(0.03, 0.7, 8)  # [rad] a start within a factor of 1.3 of the width overlaps with the data
NARROW_START_GAMMA = np.geomspace(0.0025, 0.02, 5)  # [rad] tried where no wider lobe explains the photographs
START_N = (1.2, 1.7)
START_TAIL = 0.5  # 1/ν
STARTS_SOLVED = 3  # starts, the best of all, that are moved to their minimum
START_SAMPLES = 2000  # samples, at most, on which starts are compared: half of them those nearest to a highlight
START_RANKING_STEPS = 6  # of the linear fits at the starts, which only rank them
MATERIAL_FIT_ROUNDS = 30
LOSS_ROUNDS = 6  # rounds after which the choice of the loss is final and no excluded value returns
MODEL_ERROR_ROUNDS = 15  # rounds after which the model error is final too
MATERIAL_FIT_STANDSTILL = 0.01  # change of the estimate in a round, in standard errors
INCOMPLETE_SCALE = 1.2  # robust scale above which the model is incomplete: 10 % of outliers would raise it only to 1.14
LEAST_ABSOLUTE = Loss("huber", 0.5)  # for errors of a model: most values nearly right rather than all a little wrong
SATURATION_MARGIN = 4.0  # standard deviations below the ceiling
LOG_MODEL_ERROR = (np.log(1e-6), np.log(10.0))  # range of the search, relative


def fit_material(
    observations: Observations,
    n: float | None = None,
    with_interface: bool = True,
    tails: bool = False,
    coloured: bool = False,
    start: Array | None = None,
) -> MaterialFit:
    """α c_b, β, γ and n of one material; n is fixed if given, β = 0 without `with_interface`.


    tails: whether the facets are Student's, with ν estimated, or Gaussian. coloured: whether the interface has a colour
    of its own, or that of the lamp. start: (P,) θ to start from; by default the best of many.
    Huber's loss gives the start. If the residuals are then as large as the noise, Tukey's biweight takes over: what
    remains beyond 6σ is not reflection of this kind (cast shadow, dust). If they are larger, they may be errors of the
    model, so no value is excluded: a relative model error is added to the variance, and as such errors are far from
    normal, the loss is that of least absolute deviations but for the smallest. The error is relative to model and value
    alike (`_size`): relative to the model alone, a model that is too bright would be wrong by less than 100 %, and one
    that is too dark by any amount, so that the fit would come out too bright.
    Raises `InputError` when there are too few values or the rounds do not converge.
    """
    free = _free(observations.channels, n is None, with_interface, tails, coloured)
    if np.sum(observations.used) < 10 * free.sum():
        raise InputError(
            f"{np.sum(observations.used)} usable values for {free.sum()} parameters are too few: give more pixels"
        )
    if start is not None or not with_interface:
        return _settled(observations, free, _matte_start(observations, n) if start is None else start)
    usual = _settled(observations, free, _start(observations, n, free, START_GAMMA))
    if usual.residuals.scale <= INCOMPLETE_SCALE:
        return usual
    try:
        narrow = _settled(observations, free, _start(observations, n, free, NARROW_START_GAMMA))
    except InputError:
        return usual
    return min((usual, narrow), key=lambda fit: fit.residuals.scale)


def _settled(observations: Observations, free: NDArray[np.bool_], theta: Array) -> MaterialFit:
    """The fit from `theta` (P,) in rounds of weights, variances and steps; `InputError` when they do not converge."""
    usable, lacks, model_error, change = observations.used, False, 0.0, np.inf
    signal = _size(observations, expected(observations.sight, theta))
    for turn in range(MATERIAL_FIT_ROUNDS):
        model = expected(observations.sight, theta)
        # updated in the first rounds only: a choice between two near equals could otherwise alternate for ever
        usable = usable if turn < LOSS_ROUNDS else observations.used
        observations = replace(observations, used=usable & _below_ceiling(observations, model))
        scale = _scale(observations, model)
        lacks = scale > INCOMPLETE_SCALE if turn < LOSS_ROUNDS else lacks
        if turn < MODEL_ERROR_ROUNDS:
            # geometric mean over the rounds: a lobe and the variance that follows it could otherwise alternate for ever
            signal = np.sqrt(signal * _size(observations, model))
            model_error = _model_error(observations, model, signal) if lacks else 0.0
        variance = observations.variance_at(model) + (model_error * signal) ** 2
        objective = MaterialObjective(observations, variance, LEAST_ABSOLUTE if lacks else TUKEY, shaped=_shaped(free))
        rows = minimise(objective, theta[None], free)
        moved = (rows.theta[0] - theta)[free]
        theta = rows.theta[0]
        change = float(moved @ rows.curvature[0][np.ix_(free, free)] @ moved) ** 0.5
        late = turn >= MODEL_ERROR_ROUNDS and change < MATERIAL_FIT_STANDSTILL  # along a valley that is all but flat
        if late or at_standstill(rows, change, MATERIAL_FIT_STANDSTILL):
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


def _start(observations: Observations, n: float | None, free: NDArray[np.bool_], widths: Array) -> Array:
    """The best of several starts in γ (`widths`) and n, moved to its minimum under Huber's loss."""
    grid = np.array([(g, m) for g in widths for m in (START_N if n is None else (n,))])
    matte = _matte_start(observations, n)
    theta = np.tile(matte, (len(grid), 1))
    theta[:, TAIL] = START_TAIL if free[TAIL] else 0.0
    theta[:, LOG_GAMMA], theta[:, LOG_N1] = np.log(grid[:, 0]), np.log(grid[:, 1] - 1.0)
    full, observations = observations, _few(observations)
    # if the model is incomplete, residuals of many standard deviations would make the loss a sum of absolute values
    scale = max(_scale(observations, expected(observations.sight, matte)), 1.0)
    objective = Objective(observations, scale**2 * observations.noise, HUBER)
    linear = np.arange(theta.shape[1]) < observations.channels
    linear[STRENGTH] = True
    ranked = minimise(objective, theta, linear, START_RANKING_STEPS)
    solved = replace(objective, shaped=_shaped(free))
    rows = minimise(solved, ranked.theta[np.argsort(ranked.cost)[:STARTS_SOLVED]], free)
    best = rows.theta[np.argmin(rows.cost)]
    if full is observations:
        return best
    scale = max(_scale(full, expected(full.sight, matte)), 1.0)
    whole = Objective(full, scale**2 * full.noise, HUBER, shaped=_shaped(free))
    return minimise(whole, best[None], free).theta[0]


def _few(observations: Observations) -> Observations:
    """The samples on which starts are compared, evenly over φ and the highlights in full."""
    count = len(observations.values)
    if count <= START_SAMPLES:
        return observations
    order = np.argsort(observations.sight.least_half_angle, kind="stable")
    near, half = order[: START_SAMPLES // 2], START_SAMPLES // 2
    far = order[half :: -(-(count - half) // half)]
    return observations.of(np.sort(np.concatenate([near, far])))


def _matte_start(observations: Observations, n: float | None) -> Array:
    """Parameters of the matte surface that fits best by least squares."""
    body, weight = observations.sight.body, np.where(observations.used, 1.0 / observations.noise, 0.0)
    matte = np.sum(weight * body * observations.values, axis=0) / np.maximum(np.sum(weight * body**2, axis=0), 1e-300)
    middle = np.sqrt(START_GAMMA[0] * START_GAMMA[-1])
    neutral = np.zeros(observations.channels)  # no contrasts of colour and no tail
    return np.array([*matte, *neutral, 0.0, np.log(middle), np.log((n or 1.5) - 1.0)])


def _free(channels: int, with_n: bool, with_interface: bool, tails: bool, coloured: bool) -> NDArray[np.bool_]:
    """(P,) parameters that are estimated."""
    free = np.zeros(2 * channels + 3, bool)
    free[:channels] = True
    free[colour_slice(channels)] = with_interface and coloured
    free[TAIL:] = with_interface and tails, with_interface, with_interface, with_interface and with_n
    return free


def _shaped(free: NDArray[np.bool_]) -> tuple[int, ...]:
    """Places of the numbers of the interface colour and of the tail that are estimated."""
    places = np.arange(len(free))
    chosen = free & (places >= (len(free) - 3) // 2) & (places < len(free) + STRENGTH)
    return tuple(np.flatnonzero(chosen).tolist())


def _size(observations: Observations, model: Array) -> Array:
    """What a relative error of the model is relative to: the root mean square of model and value, less its noise."""
    seen = np.maximum(observations.values**2 - observations.noise, 0.0)
    return np.sqrt(0.5 * (model**2 + seen))


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
