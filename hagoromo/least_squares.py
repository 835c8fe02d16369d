"""Least squares: one driver for every small fit, and how each fit ended.

Enters: a problem that gives the cost of a state and a damped step from it, for K independent fits at once (K = 1 for a
single one). Leaves: the state of least cost that was found, and for every fit a status: converged, stalled (no step
lowers the cost any more) or out of steps. Damping, tolerances and steps are arguments, as each fit has its own.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
State = TypeVar("State")

ROBUST_SCALE = 1.4826  # standard deviation of a normal error over its median absolute value (Hampel 1974)
NORMAL_95 = 1.959964  # 0.975 quantile of the standard normal distribution: half a 95 % interval
NORMAL_MEDIAN = 0.4549364  # median of r² for a standard normal r: χ² of one degree of freedom
CAUCHY_SCALE = 2.385  # standard deviations: 95 % efficient under normal noise (Holland & Welsch 1977)
HUBER_SCALE = 1.345  # 95 % efficient under normal noise (Huber 1981)
TUKEY_SCALE = 6.0  # 98 % efficient under normal noise, forgets what lies beyond 6σ (Mosteller & Tukey 1977)
SMALLEST_CURVATURE = 1e-300  # a coordinate of less curvature has no effect on the cost


class Status(IntEnum):
    """How a fit ended."""

    CONVERGED = 0
    STALLED = 1
    OUT_OF_STEPS = 2

    @property
    def words(self) -> str:
        """As reports and files have it."""
        return ("converged", "stalled", "out of steps")[self]


@dataclass(frozen=True)
class FitStatus:
    """How one fit ended.

    steps: those that it took. cost: ½ χ² or the sum of the loss, at the end. gradient: norm of the cost's gradient
    there, NaN where it was not computed. last_step: size of the last accepted step, in the fit's own coordinates.
    """

    status: Status
    steps: int
    cost: float = float("nan")
    gradient: float = float("nan")
    last_step: float = float("nan")

    @property
    def converged(self) -> bool:
        """Whether the fit is at a minimum, within its tolerance."""
        return self.status == Status.CONVERGED

    def record(self) -> dict[str, Any]:
        """As JSON files have it: numbers that are unknown are null."""
        numbers = {"cost": self.cost, "gradient": self.gradient, "last_step": self.last_step}
        known = {key: value if np.isfinite(value) else None for key, value in numbers.items()}
        return {"status": self.status.words, "steps": self.steps, **known}

    @staticmethod
    def from_record(record: Mapping[str, Any]) -> FitStatus:
        """The inverse of `record`."""
        status = next(one for one in Status if one.words == record["status"])
        keys = ("cost", "gradient", "last_step")
        numbers = (float("nan") if record.get(key) is None else float(record[key]) for key in keys)
        return FitStatus(status, int(record["steps"]), *numbers)

    def remark(self, name: str) -> str:
        """One line for people about the fit of `name`."""
        if self.converged:
            return f"the fit of {name} converged in {self.steps} steps"
        numbers = (("gradient", self.gradient), ("last step", self.last_step))
        known = ", ".join(f"{key} {value:.2g}" for key, value in numbers if np.isfinite(value))
        beside = f" ({known})" if known else ""
        ended = "stalled" if self.status == Status.STALLED else "did not converge"
        return f"the fit of {name} {ended} after {self.steps} steps{beside}: its result is not at a minimum"


@dataclass(frozen=True, eq=False)
class FitStatuses:
    """How K fits ended: arrays (K,) of what `FitStatus` has."""

    status: NDArray[np.int64]
    steps: NDArray[np.int64]
    cost: Array
    gradient: Array
    last_step: Array

    @property
    def converged(self) -> NDArray[np.bool_]:
        """(K,)"""
        return self.status == Status.CONVERGED

    def __getitem__(self, fit: int) -> FitStatus:
        """That of one fit."""
        return FitStatus(
            Status(int(self.status[fit])),
            int(self.steps[fit]),
            float(self.cost[fit]),
            float(self.gradient[fit]),
            float(self.last_step[fit]),
        )


@dataclass(frozen=True)
class Loss:
    """ρ(r) of a residual r in standard deviations: Huber's, Tukey's biweight or Cauchy's, with the scale k.

    Huber: r²/2 up to k, then k (|r| − k/2), convex. Tukey: k²/6 (1 − (1 − r²/k²)³), constant beyond k. Cauchy:
    k²/2 ln(1 + r²/k²). All are r²/2 near 0.
    """

    name: str
    scale: float

    def value(self, r: Array) -> Array:
        """ρ(r)."""
        k = self.scale
        if self.name == "tukey":
            return k**2 / 6 * (1.0 - np.maximum(1.0 - (r / k) ** 2, 0.0) ** 3)
        if self.name == "cauchy":
            return 0.5 * k**2 * np.log1p((r / k) ** 2)
        size = np.abs(r)
        return np.where(size <= k, 0.5 * r * r, k * (size - 0.5 * k))

    def weight(self, r: Array) -> Array:
        """ρ'(r)/r."""
        k = self.scale
        if self.name == "tukey":
            return np.maximum(1.0 - (r / k) ** 2, 0.0) ** 2
        if self.name == "cauchy":
            return 1.0 / (1.0 + (r / k) ** 2)
        return k / np.maximum(np.abs(r), k)

    def curvature(self, r: Array) -> Array:
        """ρ''(r)."""
        k = self.scale
        if self.name == "huber":
            return (np.abs(r) <= k).astype(np.float64)
        t = (r / k) ** 2
        if self.name == "tukey":
            return np.where(t < 1.0, (1.0 - t) * (1.0 - 5.0 * t), 0.0)
        return (1.0 - t) / (1.0 + t) ** 2


HUBER, TUKEY, CAUCHY = Loss("huber", HUBER_SCALE), Loss("tukey", TUKEY_SCALE), Loss("cauchy", CAUCHY_SCALE)


def robust_scale(residuals: NDArray[Any]) -> float:
    """Standard deviation of normal `residuals` about 0, by their median absolute value: 1.4826 median |r|."""
    return float(ROBUST_SCALE * np.median(np.abs(residuals)))


@dataclass(frozen=True)
class Damping:
    """Marquardt's schedule: the damping is divided by `shrink` after a step that is taken, else times `grow`.

    It stays within [least, most]; a fit whose trial is rejected at `most` has stalled. ties: whether a trial of equal
    cost is taken.
    """

    start: float = 1e-3
    shrink: float = 10.0
    grow: float = 10.0
    least: float = 1e-9
    most: float = 1e9
    ties: bool = True


@dataclass(frozen=True)
class Tolerance:
    """When a fit has converged; each test counts where its number is above 0.

    decrement: an undamped step would lower the cost by less (tested before a trial). gain, least_gain: an accepted step
    lowered the cost by less than gain · cost + least_gain. step: the size of a trial's step is less.
    """

    decrement: float = 0.0
    gain: float = 0.0
    least_gain: float = 0.0
    step: float = 0.0


class Problem(Protocol[State]):
    """K least-squares fits, whose state holds all that belongs to a point: parameters, residuals, slopes."""

    def cost(self, state: State) -> Array:
        """(K,)"""
        ...

    def decrement(self, state: State, moving: NDArray[np.bool_]) -> Array:
        """(K,) what an undamped step would lower the cost by, for the fits that are `moving`."""
        ...

    def trial(self, state: State, damping: Array, moving: NDArray[np.bool_]) -> tuple[State, Array]:
        """The state after a step of each fit that is `moving`, damped by `damping` (K,), and the steps' sizes (K,)."""
        ...

    def chosen(self, better: NDArray[np.bool_], trial: State, state: State) -> State:
        """Of each fit the state of `trial` where it is `better`, else that of `state`."""
        ...

    def gradient(self, state: State) -> Array:
        """(K,) norm of the cost's gradient."""
        ...


class Solution(NamedTuple):
    """The state that was found, how each of its fits ended, and the damping (K,) that it ended with."""

    state: Any
    statuses: FitStatuses
    damping: Array

    @property
    def status(self) -> FitStatus:
        """That of a single fit."""
        return self.statuses[0]


def levenberg_marquardt(
    problem: Problem[State],
    state: State,
    damping: Damping,
    tolerance: Tolerance,
    steps: int,
    attempts: int | None = None,
) -> Solution:
    """`state` moved to a minimum of the cost by damped Gauss–Newton steps (Levenberg 1944, Marquardt 1963).

    steps: that each fit may take. attempts: trials that one step may take, after which the fit has stalled; None: each
    trial counts as a step, accepted or not.
    """
    cost = np.array(problem.cost(state), np.float64)
    moving, ended = np.ones(len(cost), bool), np.full(len(cost), int(Status.OUT_OF_STEPS))
    taken, rejected = np.zeros(len(cost), np.int64), np.zeros(len(cost), np.int64)
    size, last = np.full(len(cost), damping.start), np.zeros(len(cost))

    def end(fits: NDArray[np.bool_], status: Status) -> None:
        ended[fits] = status
        moving[fits] = False

    while moving.any():
        if tolerance.decrement:
            end(moving & (problem.decrement(state, moving) < tolerance.decrement), Status.CONVERGED)
        end(moving & (taken >= steps), Status.OUT_OF_STEPS)
        if not moving.any():
            break
        trial, length = problem.trial(state, size, moving)
        lower = np.asarray(problem.cost(trial), np.float64)
        better = moving & ((lower <= cost) if damping.ties else (lower < cost))
        little = cost - lower < tolerance.gain * cost + tolerance.least_gain
        state = problem.chosen(better, trial, state)
        cost, last = np.where(better, lower, cost), np.where(better, length, last)
        taken, rejected = taken + (moving if attempts is None else better), np.where(better, 0, rejected + 1)
        lost = moving & ~better & ((size >= damping.most) if attempts is None else (rejected >= attempts))
        changed = np.where(
            better, np.maximum(size / damping.shrink, damping.least), np.minimum(size * damping.grow, damping.most)
        )
        size = np.where(moving, changed, size)
        end(lost, Status.STALLED)
        end((better & little) | (moving & (length < tolerance.step)), Status.CONVERGED)
    return Solution(state, FitStatuses(ended, taken, cost, problem.gradient(state), last), size)


class SingleFit(Protocol):
    """A point of one structured fit: what is minimised there, and where a damped step leads."""

    @property
    def cost(self) -> float:
        """What is minimised."""
        ...

    @property
    def gradient(self) -> float:
        """Norm of the cost's gradient."""
        ...

    def trial(self, damping: float) -> tuple[Any, float]:
        """The point after a damped step, and the size of the step."""
        ...


class SingleProblem:
    """One structured fit as a `Problem` of K = 1; a state is a `SingleFit`."""

    def cost(self, state: SingleFit) -> Array:
        """(1,)"""
        return np.array([state.cost])

    def decrement(self, state: SingleFit, moving: NDArray[np.bool_]) -> Array:
        """Not known: structured fits converge by their gain or their step."""
        return np.full(1, np.inf)

    def trial(self, state: SingleFit, damping: Array, moving: NDArray[np.bool_]) -> tuple[SingleFit, Array]:
        """The point after a damped step."""
        point, length = state.trial(float(damping[0]))
        return point, np.array([length])

    def chosen(self, better: NDArray[np.bool_], trial: SingleFit, state: SingleFit) -> SingleFit:
        """`trial` where it is better."""
        return trial if better[0] else state

    def gradient(self, state: SingleFit) -> Array:
        """(1,)"""
        return np.array([state.gradient])


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


def scipy_status(result: Any) -> FitStatus:
    """How a fit by `scipy.optimize` (least_squares, lsq_linear, minimize) ended."""
    steps = int(getattr(result, "nfev", None) or getattr(result, "nit", 0) or 0)
    cost = getattr(result, "cost", None)
    gradient = getattr(result, "grad", None)
    return FitStatus(
        Status.CONVERGED if result.success else Status.OUT_OF_STEPS,
        steps,
        float(result.fun if cost is None else cost),
        float("nan") if gradient is None else float(np.linalg.norm(gradient)),
    )
