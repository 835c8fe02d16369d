"""Photometric fit: gloss, lamps and model error from a subset of the pixels, then normal and body of every pixel.

Model errors are correlated over large parts of an object, so each photograph enters with its effective number of
independent values (`independent_share`).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hagoromo.least_squares import NORMAL_MEDIAN, Damping, SingleProblem, Tolerance, levenberg_marquardt
from hagoromo.measurement.normals.lamp_shift import shifted_lamps
from hagoromo.measurement.normals.photometric_model import Fit, Prior, precision, predicted, size
from hagoromo.measurement.normals.photometric_step import Problem, Step
from hagoromo.measurement.normals.pixel_fit import Light, fit_pixels
from hagoromo.measurement.normals.views import Views

SUBSET = 2000  # pixels from which gloss and lamps are estimated
PHOTOMETRIC_FIT_STEPS, PHOTOMETRIC_FIT_ROUNDS = 12, 3
PHOTOMETRIC_FIT_DAMPING = Damping(start=1e-2, shrink=5.0, grow=5.0, least=1e-5, most=np.inf, ties=False)
PHOTOMETRIC_FIT_GAIN = 1e-4  # relative to the cost: a step that gains less is the last
SMALLEST_MODEL_ERROR = 0.003  # relative


def photometric_fit(views: Views, start: Fit, prior: Prior | None = None, seed: int = 0) -> tuple[Views, Fit]:
    """Gloss, lamps and model error from a subset of the pixels, then normals and body of all pixels.

    The returned views are `views` under the fitted lamps and at the fitted distance.
    """
    fit = fit_together(views, start, prior or Prior(), seed)
    views = views.under(shifted_lamps(views, fit.shift), float(np.exp(fit.depth)))
    light = Light(fit.gloss.rows[fit.labels], fit.evenness(views.place), precision(views, fit.model_error))
    pixels = fit_pixels(views, light, start.normals, start.body)
    return views, replace(
        fit, normals=pixels.normals, body=pixels.body, variance=pixels.variance, pixel_status=pixels.status
    )


def fit_together(views: Views, start: Fit, prior: Prior, seed: int = 0) -> Fit:
    """Gloss, lamps and model error from SUBSET pixels of `views`; normals and body of all pixels are not changed.

    The scales of the prior of the lamps are learnt along the way; `prior` states them at the start.
    """
    count = len(views.rows)
    chosen = np.sort(np.random.default_rng(seed).choice(count, min(SUBSET, count), replace=False))
    share = independent_share(views, start) * count / len(chosen)
    problem = Problem(views.pixels(chosen), views.place[chosen], share, prior)
    fit, status = start.pixels(chosen), None
    for _ in range(PHOTOMETRIC_FIT_ROUNDS):
        start_of_round = Step(problem, fit)
        tolerance = Tolerance(gain=PHOTOMETRIC_FIT_GAIN)
        solution = levenberg_marquardt(
            SingleProblem(), start_of_round, PHOTOMETRIC_FIT_DAMPING, tolerance, PHOTOMETRIC_FIT_STEPS
        )
        first, step, status = start_of_round.cost, solution.state, solution.status
        fit = replace(step.fit, model_error=_model_error(step))
        learnt = problem.prior.learnt(prior, step.of_lamps, step.covariances()[1])
        problem = replace(problem, prior=learnt)
        if first - step.cost < 1e-3 * first:
            break
    step = Step(problem, fit)
    return replace(
        start,
        gloss=fit.gloss,
        strength=fit.strength,
        slope=fit.slope,
        shift=fit.shift,
        depth=fit.depth,
        model_error=fit.model_error,
        covariance=step.covariances()[0],
        status=status,
    )


def independent_share(views: Views, fit: Fit) -> float:
    """Independent values per pixel of a photograph: Σ r² over Σ (Σ r)² of tiles half the object's radius wide.

    It is 1/C for residuals that are noise, and one per tile for an error of the model that is the same all over a
    tile and in all C channels.
    """
    grey = views.values.mean(axis=1)
    model = predicted(fit, views.to_lamp, views.to_eye).mean(axis=1)
    scale = np.maximum(size(views)[:, 0], 1e-30)  # 0 for a pixel that is dark in all photographs
    relative = np.where(views.used, (grey - model) / scale, 0.0)
    limit = 3.0 * np.sqrt(np.median(relative[views.used] ** 2) / NORMAL_MEDIAN)
    relative = np.clip(relative, -limit, limit)
    side = max(int(0.5 * np.sqrt(len(views.rows) / np.pi)), 1)
    tile = (views.rows // side) * (views.shape[1] // side + 1) + views.columns // side
    sums = sum(float(np.sum(np.bincount(tile, row) ** 2)) for row in relative)
    return float(min(np.sum(relative**2) / max(sums, 1e-30), 1.0)) / views.values.shape[1]


def _model_error(step: Step) -> float:
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
