"""The refractive index of a material whose gloss varies over its pixels.

Gloss that varies over the surface is correlated with the angles, and this must not be attributed to Fresnel's law. So n
is estimated from the values of each pixel under several lamps, with its gloss free. The search is repeated on simulated
copies of the photographs with independent noise, and the bias found there is subtracted.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hagoromo.least_squares.loss import NORMAL_95
from hagoromo.measurement.gloss.gloss_law import deviance
from hagoromo.measurement.gloss.pixel_gloss import PixelGlossFit
from hagoromo.measurement.material.estimate import PRIOR_N
from hagoromo.measurement.material.uncertainty import RELATIVE_LIMIT
from hagoromo.measurement.parameters import N_RANGE
from hagoromo.measurement.photometric.gloss_posterior import GlossLaw, PixelGloss
from hagoromo.measurement.sight import Array

FEWEST_PIXELS = 10  # informative pixels
LARGEST_PIXEL_ERROR = 0.15  # standard error of ln β and ln γ, from the photographs alone, of an informative pixel
FLAT_PRIOR = 1e3  # standard deviation of a prior that has no effect
NODES = 0.15 * np.arange(-3, 4)  # of ln(n − 1), around the estimate: a parabola through them gives n and its error
INDEX_SEARCH_TURNS = 4  # largest number of parabolas
COPIES, SEED = 4, 0  # simulated copies of the photographs, and the seed of their noise


@dataclass(frozen=True)
class Index:
    """n and the variance of ln(n − 1), 0 if n was given or chosen. interval: 95 %, of n; None if n was given."""

    n: float
    variance: float = 0.0
    interval: tuple[float, float] | None = None


def refractive_index(fit: PixelGlossFit, estimates: PixelGloss, n: float) -> Index:
    """n from the pixels whose gloss is identifiable without a prior, given `estimates` at `n`; else PRIOR_N.

    The minimum of a parabola is the next start; after INDEX_SEARCH_TURNS of them the last one is used as it is.
    """
    informative = np.linalg.eigvalsh(estimates.information)[:, 0] > 1.0 / LARGEST_PIXEL_ERROR**2
    low, high = (float(np.log(bound - 1.0)) for bound in N_RANGE)
    if np.sum(informative) < FEWEST_PIXELS:
        return Index(PRIOR_N, 0.0, N_RANGE)
    few, gloss = fit.of(informative), estimates.gloss[informative]
    best, error = _search(few, gloss, n)
    if np.isfinite(error):
        index, random, own = 1.0 + float(np.exp(best)), np.random.default_rng(SEED), few.observations
        at_best = _with_index(few, gloss, n, best)
        model, spread = at_best[0].model(at_best[1]), np.sqrt(few.noise**2 * own.variance_at(few.model(gloss)))
        copies = [replace(own, values=model + spread * random.standard_normal(model.shape)) for _ in range(COPIES)]
        copy_estimates = [_search(few.with_values(copy), at_best[1], index)[0] for copy in copies]
        best, error = best - (float(np.mean(copy_estimates)) - best), error * (1.0 + 1.0 / COPIES) ** 0.5
    inside = low < best - NORMAL_95 * error and best + NORMAL_95 * error < high
    first, last = 1.0 + np.exp(np.clip([best - NORMAL_95 * error, best + NORMAL_95 * error], low, high))
    if error > RELATIVE_LIMIT or not inside:
        return Index(float(np.clip(PRIOR_N, first, last)), 0.0, (float(first), float(last)))
    return Index(1.0 + float(np.exp(best)), error**2, (float(first), float(last)))


def _search(fit: PixelGlossFit, gloss: Array, n: float) -> tuple[float, float]:
    """ln(n − 1) of highest likelihood, and its standard error; gloss (P, 2): at `n`."""
    low, high = (float(np.log(bound - 1.0)) for bound in N_RANGE)
    middle, best, error = float(np.log(n - 1.0)), 0.0, np.inf
    for _ in range(INDEX_SEARCH_TURNS):
        nodes = np.clip(middle + NODES, low, high)
        curve = np.polyfit(nodes - middle, [_any_gloss(fit, gloss, n, node) for node in nodes], 2)
        error = float(curve[0] ** -0.5) if curve[0] > 0.0 else np.inf
        step = float(-0.5 * curve[1] / curve[0]) if curve[0] > 0.0 else 0.0
        best = float(np.clip(middle + np.clip(step, NODES[0], NODES[-1]), low, high))
        if abs(best - middle) < NODES[-1] / 3.0:
            break
        middle = best
    return best, error


def _any_gloss(fit: PixelGlossFit, gloss: Array, n: float, log_n1: float) -> float:
    """−2 ln likelihood of all pixels at ln(n − 1), with the gloss of each pixel free; gloss (P, 2): at `n`."""
    moved, start = _with_index(fit, gloss, n, log_n1)
    law = GlossLaw(start.mean(axis=0), FLAT_PRIOR**2 * np.eye(2))
    return float(deviance(moved.evaluate(moved.settled(start, law)[0]), law).sum())


def _with_index(fit: PixelGlossFit, gloss: Array, n: float, log_n1: float) -> tuple[PixelGlossFit, Array]:
    """`fit` at another ln(n − 1) with its weights, and `gloss` (P, 2) rescaled to the same β."""
    other = 1.0 + float(np.exp(log_n1))
    ratio = (other - 1.0) / (other + 1.0) * (n + 1.0) / (n - 1.0)
    moved = PixelGlossFit(fit.observations, other, fit.noise, fit.shape)
    moved.weigh(fit.weight)
    return moved, gloss + np.array([2.0 * np.log(ratio), 0.0])
