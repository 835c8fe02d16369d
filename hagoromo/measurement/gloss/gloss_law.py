"""The law of a material's gloss: the normal law that makes the photographs of its pixels most likely.

The likelihood of each pixel is taken for a normal one around its estimate (Laplace), so that the integral over its
gloss is closed.
"""

from __future__ import annotations

import numpy as np

from hagoromo.least_squares import SMALLEST_CURVATURE, FitStatus, Status
from hagoromo.measurement.gloss.pixel_gloss import GlossLaw, PixelGloss
from hagoromo.measurement.sight import Array

GLOSS_LAW_STEPS = 200  # of expectation and maximisation
STANDSTILL = 1e-3  # relative change of the covariance


def likeliest(found: PixelGloss, law: GlossLaw) -> tuple[GlossLaw, FitStatus]:
    """The law that makes the photographs most likely, and how the search ended (Dempster, Laird & Rubin 1977).

    It starts from `law`. The last step is relative to the largest variance.
    """
    told = found.pull + np.einsum("pij,pj->pi", found.information, found.gloss)
    mean, spread, change = law.mean, law.covariance, np.inf
    for step in range(GLOSS_LAW_STEPS):
        prior = GlossLaw(mean, spread).information
        covariance = np.linalg.inv(found.information + prior)
        gloss = np.einsum("pij,pj->pi", covariance, told + prior @ mean)
        mean = gloss.mean(axis=0)
        off = gloss - mean
        last, spread = spread, covariance.mean(axis=0) + off.T @ off / len(off)
        change = float(np.abs(spread - last).max() / max(np.abs(spread).max(), SMALLEST_CURVATURE))
        if np.abs(spread - last).max() < STANDSTILL * np.abs(spread).max():
            return GlossLaw(mean, spread), FitStatus(Status.CONVERGED, step + 1, last_step=change)
    return GlossLaw(mean, spread), FitStatus(Status.OUT_OF_STEPS, GLOSS_LAW_STEPS, last_step=change)


def lack(found: PixelGloss, law: GlossLaw) -> Array:
    """(P,) −2 ln of each pixel's likelihood under `law`, its gloss integrated over."""
    prior, off = law.information, found.gloss - law.mean
    pull = found.pull - off @ prior
    # from where `found` stands to the maximum, χ² being quadratic
    further = np.einsum("pi,pij,pj->p", pull, np.linalg.inv(found.information + prior), pull)
    volume = np.linalg.slogdet(found.information + prior)[1] - np.linalg.slogdet(prior)[1]
    return found.chi_square + np.einsum("pi,ij,pj->p", off, prior, off) - further + volume


def covariance_of_mean(found: PixelGloss, law: GlossLaw) -> Array:
    """(2, 2) covariance of the law's mean."""
    prior = law.information
    return np.linalg.inv(np.sum(prior - prior @ found.covariance @ prior, axis=0))
