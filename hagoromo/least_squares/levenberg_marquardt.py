"""Levenberg–Marquardt: the one driver of every small fit.

Enters: a problem that gives the cost of a state and a damped step from it, for K independent fits at once (K = 1 for a
single one). Leaves: the state of least cost that was found, and for every fit a status. Damping, tolerances and steps
are arguments, as each fit has its own.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from hagoromo.least_squares.fit_status import FitStatus, FitStatuses, Status

Array = NDArray[np.float64]
State = TypeVar("State")


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
