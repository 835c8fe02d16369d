"""Rounds: gloss and lamps settled at a model error that follows from the residuals, until both agree."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from hagoromo.least_squares.fit_status import FitStatus
from hagoromo.least_squares.levenberg_marquardt import Damping, SingleProblem, Tolerance, levenberg_marquardt
from hagoromo.least_squares.loss import NORMAL_MEDIAN
from hagoromo.measurement.normals.photometric_model import Fit, Prior, size
from hagoromo.measurement.normals.photometric_step import PixelProblem, PixelStep

PHOTOMETRIC_FIT_STEPS, PHOTOMETRIC_FIT_ROUNDS = 12, 3
PHOTOMETRIC_FIT_DAMPING = Damping(start=1e-2, shrink=5.0, grow=5.0, least=1e-5, most=np.inf, ties=False)
PHOTOMETRIC_FIT_GAIN = 1e-4  # relative to the cost: a step that gains less is the last
SMALLEST_MODEL_ERROR = 0.003  # relative


class Rounds(NamedTuple):
    """The last point, whose problem has the prior that was learnt, and how the last round ended."""

    step: PixelStep
    status: FitStatus


def settled(start: PixelStep, gain: float = PHOTOMETRIC_FIT_GAIN) -> tuple[PixelStep, FitStatus]:
    """The nearest minimum of the problem, at the model error of `start`, and how the way there ended."""
    tolerance = Tolerance(gain=gain)
    solution = levenberg_marquardt(SingleProblem(), start, PHOTOMETRIC_FIT_DAMPING, tolerance, PHOTOMETRIC_FIT_STEPS)
    return solution.state, solution.status


def rounds(problem: PixelProblem, fit: Fit, stated: Prior) -> Rounds:
    """Gloss, lamps and model error from `fit` on.

    The scales of the prior of the lamps are learnt along the way; `stated` has them as they were stated.
    """
    step, status = PixelStep(problem, fit), None
    for _ in range(PHOTOMETRIC_FIT_ROUNDS):
        first = step.cost
        end, status = settled(step)
        learnt = step.problem.prior.learnt(stated, end.of_lamps, end.covariances()[1])
        step = PixelStep(replace(step.problem, prior=learnt), replace(end.fit, model_error=_model_error(end)))
        if first - end.cost < 1e-3 * first:
            break
    assert status is not None  # there is a round at least
    return Rounds(step, status)


def _model_error(step: PixelStep) -> float:
    """Relative error of the model for which the median of the squared residuals is that of a normal distribution."""
    used = np.broadcast_to(step.problem.views.used[:, None], step.model.shape)
    channels, pixels = step.model.shape[1:]
    freedom = 1.0 - (2.0 + channels) * pixels / max(float(used.sum()), 1.0)
    squared = (step.deviation**2)[used] / max(freedom, 0.1)
    noise, signal = step.problem.views.variance[used], size(step.problem.views)[used] ** 2
    low, high = np.log(SMALLEST_MODEL_ERROR), 0.0
    for _ in range(30):
        middle = 0.5 * (low + high)
        excess = np.median(squared / (noise + np.exp(2 * middle) * signal)) > NORMAL_MEDIAN
        low, high = (middle, high) if excess else (low, middle)
    return float(np.exp(0.5 * (low + high)))
