"""Rounds: gloss and lamps settled at a model error that follows from the residuals, until both agree.

Independent share: how many independent values a photograph has per pixel.

It is Σ r² over Σ (Σ r)² of tiles half the object's radius wide: 1/C for residuals r that are noise, and one a tile for
an error of the model that is the same all over a tile and in all C channels.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.least_squares.fit_status import FitStatus
from hagoromo.least_squares.levenberg_marquardt import Damping, SingleProblem, Tolerance, levenberg_marquardt
from hagoromo.least_squares.loss import NORMAL_MEDIAN
from hagoromo.measurement.normals.photometric_model import Fit, Prior, predicted, size
from hagoromo.measurement.normals.photometric_step import PixelProblem, PixelStep
from hagoromo.measurement.normals.views import Array, Views

PHOTOMETRIC_FIT_STEPS, PHOTOMETRIC_FIT_ROUNDS = 12, 3
PHOTOMETRIC_FIT_DAMPING = Damping(start=1e-2, shrink=5.0, grow=5.0, least=1e-5, most=np.inf, ties=False)
PHOTOMETRIC_FIT_GAIN = 1e-4  # relative to the cost: a step that gains less is the last
SMALLEST_MODEL_ERROR = 0.003  # relative
FARTHEST = 3.0  # robust standard deviations to which residuals are cut off


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


def independent_share(views: Views, fit: Fit) -> float:
    """The share of all pixels of `views`, by the residuals of `fit` under even lamps."""
    deviation = views.values - predicted(fit, views.to_lamp, views.to_eye)
    side = max(int(0.5 * np.sqrt(len(views.rows) / np.pi)), 1)
    tile = (views.rows // side) * (views.shape[1] // side + 1) + views.columns // side
    return _share(views, deviation, tile)


def share_of_step(step: PixelStep) -> float:
    """The share of the pixels of the problem of `step`, by its residuals."""
    tile = np.floor(2.0 * step.problem.place).astype(np.int64)  # radii of the object
    tile -= tile.min(axis=0)
    return _share(step.problem.views, step.deviation, tile[:, 1] * (int(tile[:, 0].max()) + 1) + tile[:, 0])


def _share(views: Views, deviation: Array, tile: NDArray[np.integer]) -> float:
    scale = np.maximum(size(views)[:, 0], 1e-30)  # 0 for a pixel that is dark in all photographs
    relative = np.where(views.used, deviation.mean(axis=1) / scale, 0.0)
    limit = FARTHEST * np.sqrt(np.median(relative[views.used] ** 2) / NORMAL_MEDIAN)
    relative = np.clip(relative, -limit, limit)
    sums = sum(float(np.sum(np.bincount(tile, row) ** 2)) for row in relative)
    return float(min(np.sum(relative**2) / max(sums, 1e-30), 1.0)) / views.values.shape[1]
