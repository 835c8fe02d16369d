"""Photometric fit: gloss, lamps and model error from a part of the pixels, then normal and body colour of every pixel.

Errors of the model are alike over large parts of an object, so a photograph counts as so many independent values as
its residuals show (`independent_share`).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hagoromo.least_squares import NORMAL_MEDIAN, Damping, SingleProblem, Tolerance, levenberg_marquardt
from hagoromo.measurement.normals.lamp_shift import shifted_lamps
from hagoromo.measurement.normals.photometric_model import Fit, precision, predicted, size
from hagoromo.measurement.normals.photometric_prior import Prior
from hagoromo.measurement.normals.photometric_step import Problem, Step
from hagoromo.measurement.normals.pixel_fit import Light, fit_pixels
from hagoromo.measurement.normals.views import Views

SUBSET = 2000  # pixels that gloss and lamps are estimated from
PHOTOMETRIC_FIT_STEPS, PHOTOMETRIC_FIT_ROUNDS = 12, 3
PHOTOMETRIC_FIT_DAMPING = Damping(start=1e-2, shrink=5.0, grow=5.0, least=1e-5, most=np.inf, ties=False)
PHOTOMETRIC_FIT_GAIN = 1e-4  # of the cost: a step that gains less is the last
FLOOR = 0.003  # least relative error of the model


def photometric_fit(seen: Views, start: Fit, prior: Prior | None = None, seed: int = 0) -> tuple[Views, Fit]:
    """Everything: gloss, lamps and model error from a subset of the pixels, then normals and body of all.

    The views that it gives are `seen` under the lamps, and of points, where the fit has them.
    """
    fit = fit_together(seen, start, prior or Prior(), seed)
    seen = seen.under(shifted_lamps(seen, fit.shift), float(np.exp(fit.depth)))
    light = Light(fit.gloss.rows[fit.labels], fit.evenness(seen.place), precision(seen, fit.model_error))
    pixels = fit_pixels(seen, light, start.normals, start.body)
    return seen, replace(
        fit, normals=pixels.normals, body=pixels.body, variance=pixels.variance, pixel_status=pixels.status
    )


def fit_together(seen: Views, start: Fit, prior: Prior, seed: int = 0) -> Fit:
    """Gloss, lamps and model error from SUBSET pixels of `seen`; normals and body of all pixels stay as they are.

    The scales of the lamps' prior are learnt on the way, `prior` counting as what they were stated to be.
    """
    count = len(seen.rows)
    chosen = np.sort(np.random.default_rng(seed).choice(count, min(SUBSET, count), replace=False))
    share = independent_share(seen, start) * count / len(chosen)
    problem = Problem(seen.pixels(chosen), seen.place[chosen], share, prior)
    fit, status = start.pixels(chosen), None
    for _ in range(PHOTOMETRIC_FIT_ROUNDS):
        start_of_round = Step(problem, fit)
        tolerance = Tolerance(gain=PHOTOMETRIC_FIT_GAIN)
        found = levenberg_marquardt(
            SingleProblem(), start_of_round, PHOTOMETRIC_FIT_DAMPING, tolerance, PHOTOMETRIC_FIT_STEPS
        )
        first, step, status = start_of_round.cost, found.state, found.status
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


def independent_share(seen: Views, fit: Fit) -> float:
    """Independent values per pixel of a photograph: Σ r² over Σ (Σ r)² of tiles half the object's radius wide.

    1/C for residuals that are noise, one per tile for those of a model that is wrong all over: its errors are alike in
    all C channels.
    """
    grey = seen.values.mean(axis=1)
    model = predicted(fit, seen.to_lamp, seen.to_eye).mean(axis=1)
    scale = np.maximum(size(seen)[:, 0], 1e-30)  # a pixel that no photograph sees anything of has 0
    relative = np.where(seen.used, (grey - model) / scale, 0.0)
    limit = 3.0 * np.sqrt(np.median(relative[seen.used] ** 2) / NORMAL_MEDIAN)
    relative = np.clip(relative, -limit, limit)
    side = max(int(0.5 * np.sqrt(len(seen.rows) / np.pi)), 1)
    tile = (seen.rows // side) * (seen.shape[1] // side + 1) + seen.columns // side
    sums = sum(float(np.sum(np.bincount(tile, row) ** 2)) for row in relative)
    return float(min(np.sum(relative**2) / max(sums, 1e-30), 1.0)) / seen.values.shape[1]


def _model_error(step: Step) -> float:
    """Relative error of the model that makes the median of the squared residuals that of a normal error."""
    used = np.broadcast_to(step.problem.seen.used[:, None], step.model.shape)
    channels, pixels = step.model.shape[1:]
    freedom = 1.0 - (2.0 + channels) * pixels / max(float(used.sum()), 1.0)
    squared = (step.deviation**2)[used] / max(freedom, 0.1)
    noise, signal = step.problem.seen.variance[used], size(step.problem.seen)[used] ** 2
    low, high = np.log(FLOOR), 0.0
    for _ in range(30):
        middle = 0.5 * (low + high)
        excess = np.median(squared / (noise + np.exp(2 * middle) * signal)) > NORMAL_MEDIAN
        low, high = (middle, high) if excess else (low, middle)
    return float(np.exp(0.5 * (low + high)))
