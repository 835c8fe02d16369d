"""Photometric fit: gloss, lamps and model error from a subset of the pixels, then normal and body of every pixel.

Model errors are correlated over large parts of an object, so each photograph enters with its effective number of
independent values (`independent_share`).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hagoromo.measurement.normals.gloss_choice import BY_EVIDENCE, GlossModel, choose_gloss
from hagoromo.measurement.normals.independent_share import independent_share
from hagoromo.measurement.normals.lamp_shift import shifted_lamps
from hagoromo.measurement.normals.photometric_model import Fit, Prior, precision
from hagoromo.measurement.normals.photometric_step import PixelProblem
from hagoromo.measurement.normals.pixel_fit import PixelConditions, fit_pixels
from hagoromo.measurement.normals.views import Views

SUBSET = 2000  # pixels from which gloss and lamps are estimated


def photometric_fit(
    views: Views, start: Fit, prior: Prior | None = None, model: GlossModel = BY_EVIDENCE, seed: int = 0
) -> tuple[Views, Fit]:
    """Gloss, lamps and model error from a subset of the pixels, then normals and body of all pixels.

    The returned views are `views` under the fitted lamps and at the fitted distance.
    """
    fit = fit_together(views, start, prior or Prior(), model, seed)
    views = views.under(shifted_lamps(views, fit.shift), float(np.exp(fit.depth)))
    light = PixelConditions(fit.gloss.rows[fit.labels], fit.evenness(views.place), precision(views, fit.model_error))
    pixels = fit_pixels(views, light, start.normals, start.body)
    return views, replace(
        fit, normals=pixels.normals, body=pixels.body, variance=pixels.variance, pixel_status=pixels.status
    )


def fit_together(views: Views, start: Fit, prior: Prior, model: GlossModel = BY_EVIDENCE, seed: int = 0) -> Fit:
    """Gloss, lamps and model error from SUBSET pixels of `views`; normals and body of all pixels are not changed."""
    count = len(views.rows)
    chosen = np.sort(np.random.default_rng(seed).choice(count, min(SUBSET, count), replace=False))
    share = independent_share(views, start) * count / len(chosen)
    every = np.ones(start.gloss.rows.shape, bool)  # numbers of gloss; which of them are free is chosen next
    problem = PixelProblem(views.pixels(chosen), views.place[chosen], share, prior, every)
    (step, status), choice = choose_gloss(problem, start.pixels(chosen), model)
    fit, covariance = step.fit, step.covariances()[0]
    return replace(
        start,
        gloss=fit.gloss,
        strength=fit.strength,
        slope=fit.slope,
        shift=fit.shift,
        depth=fit.depth,
        model_error=fit.model_error,
        covariance=covariance,
        lamp_variance=step.relative_variance(),
        prior=step.problem.prior,
        choice=choice,
        status=status,
    )
