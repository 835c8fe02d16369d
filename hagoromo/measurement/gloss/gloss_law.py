"""Gloss law: the normal distribution of gloss over a material with the highest likelihood of its photographs.

The likelihood of each pixel is approximated by a normal one around its estimate (Laplace), so that the integral over
its gloss has a closed form.
"""

from __future__ import annotations

import numpy as np

from hagoromo.least_squares.fit_status import FitStatus, Status
from hagoromo.least_squares.rows import SMALLEST_CURVATURE
from hagoromo.measurement.photometric.gloss_posterior import GlossLaw, PixelGloss
from hagoromo.measurement.sight import Array

GLOSS_LAW_STEPS = 200  # of expectation maximisation
LARGEST_CHANGE = 1e-3  # relative change of the covariance in a step: below it the search has converged


def likeliest(estimates: PixelGloss, law: GlossLaw) -> tuple[GlossLaw, FitStatus]:
    """The law of highest likelihood, and how the search ended (Dempster, Laird & Rubin 1977).

    The search starts from `law`. Its last step is relative to the largest variance.
    """
    weighted_gloss = estimates.score + np.einsum("pij,pj->pi", estimates.information, estimates.gloss)
    mean, spread, change = law.mean, law.covariance, np.inf
    for step in range(GLOSS_LAW_STEPS):
        prior = GlossLaw(mean, spread).information
        covariance = np.linalg.inv(estimates.information + prior)
        gloss = np.einsum("pij,pj->pi", covariance, weighted_gloss + prior @ mean)
        mean = gloss.mean(axis=0)
        off = gloss - mean
        last, spread = spread, covariance.mean(axis=0) + off.T @ off / len(off)
        change = float(np.abs(spread - last).max() / max(np.abs(spread).max(), SMALLEST_CURVATURE))
        if np.abs(spread - last).max() < LARGEST_CHANGE * np.abs(spread).max():
            return GlossLaw(mean, spread), FitStatus(Status.CONVERGED, step + 1, last_step=change)
    return GlossLaw(mean, spread), FitStatus(Status.OUT_OF_STEPS, GLOSS_LAW_STEPS, last_step=change)


def deviance(estimates: PixelGloss, law: GlossLaw) -> Array:
    """(P,) −2 ln of the marginal likelihood of each pixel under `law`, integrated over its gloss."""
    prior, off = law.information, estimates.gloss - law.mean
    score = estimates.score - off @ prior
    # from the current point to the maximum of the posterior; χ² is quadratic there
    further = np.einsum("pi,pij,pj->p", score, np.linalg.inv(estimates.information + prior), score)
    volume = np.linalg.slogdet(estimates.information + prior)[1] - np.linalg.slogdet(prior)[1]
    return estimates.chi_square + np.einsum("pi,ij,pj->p", off, prior, off) - further + volume


def covariance_of_mean(estimates: PixelGloss, law: GlossLaw) -> Array:
    """(2, 2) covariance of the law's mean."""
    prior = law.information
    return np.linalg.inv(np.sum(prior - prior @ estimates.covariance @ prior, axis=0))
