"""The refractive index of a material whose gloss varies over its pixels.

Gloss that drifts over the surface drifts with the angles too, which must not be taken for Fresnel's law. So n is told
by what each pixel shows under several lamps, its gloss being any. The search is repeated on copies of the photographs
with noise of their own, and the bias that it has there is taken off.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hagoromo.measurement.gloss.gloss_law import lack
from hagoromo.measurement.gloss.pixel_gloss import GlossLaw, PixelFit, PixelGloss
from hagoromo.measurement.material.estimate import PRIOR_N
from hagoromo.measurement.material.uncertainty import RELATIVE_LIMIT
from hagoromo.measurement.robust_fit import N_RANGE
from hagoromo.measurement.sight import Array

FEWEST_PIXELS = 10  # that tell n
WELL_TOLD = 0.15  # standard error of ln β and ln γ by the photographs alone, of pixels that are asked for n
ANY = 1e3  # standard deviation of a law that says nothing
NORMAL_95 = 1.959964
NODES = 0.15 * np.arange(-3, 4)  # of ln(n − 1), to either side: a parabola through them tells n and its error
INDEX_SEARCH_TURNS = 4  # of the search
COPIES, SEED = 4, 0  # of the photographs


@dataclass(frozen=True)
class Index:
    """n and the variance of ln(n − 1); 0 where n was given or chosen. interval: of n, 95 %; None where it was given."""

    n: float
    variance: float = 0.0
    interval: tuple[float, float] | None = None


def refractive_index(fit: PixelFit, found: PixelGloss, n: float) -> Index:
    """n by the pixels whose gloss is told without a law, from `found` at `n`; PRIOR_N where they do not tell it."""
    told = np.linalg.eigvalsh(found.information)[:, 0] > 1.0 / WELL_TOLD**2
    low, high = (float(np.log(bound - 1.0)) for bound in N_RANGE)
    if np.sum(told) < FEWEST_PIXELS:
        return Index(PRIOR_N, 0.0, N_RANGE)
    few, gloss = fit.of(told), found.gloss[told]
    best, error = _search(few, gloss, n)
    if np.isfinite(error):
        index, random, own = 1.0 + float(np.exp(best)), np.random.default_rng(SEED), few.seen
        there = _with_index(few, gloss, n, best)
        model, spread = there[0].model(there[1]), np.sqrt(few.noise**2 * own.variance_at(few.model(gloss)))
        copies = [replace(own, values=model + spread * random.standard_normal(model.shape)) for _ in range(COPIES)]
        again = [_search(few.with_values(copy), there[1], index)[0] for copy in copies]
        best, error = best - (float(np.mean(again)) - best), error * (1.0 + 1.0 / COPIES) ** 0.5
    inside = low < best - NORMAL_95 * error and best + NORMAL_95 * error < high
    first, last = 1.0 + np.exp(np.clip([best - NORMAL_95 * error, best + NORMAL_95 * error], low, high))
    if error > RELATIVE_LIMIT or not inside:
        return Index(float(np.clip(PRIOR_N, first, last)), 0.0, (float(first), float(last)))
    return Index(1.0 + float(np.exp(best)), error**2, (float(first), float(last)))


def _search(fit: PixelFit, gloss: Array, n: float) -> tuple[float, float]:
    """ln(n − 1) at which the photographs are most likely, and its standard error; gloss (P, 2): at `n`."""
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


def _any_gloss(fit: PixelFit, gloss: Array, n: float, log_n1: float) -> float:
    """−2 ln likelihood of all pixels at ln(n − 1), the gloss of each being any; gloss (P, 2): at `n`."""
    moved, start = _with_index(fit, gloss, n, log_n1)
    law = GlossLaw(start.mean(axis=0), ANY**2 * np.eye(2))
    return float(lack(moved.at(moved.settled(start, law)[0]), law).sum())


def _with_index(fit: PixelFit, gloss: Array, n: float, log_n1: float) -> tuple[PixelFit, Array]:
    """`fit` at another ln(n − 1), its weights kept, and `gloss` (P, 2) there: with the β that it has at `n`."""
    other = 1.0 + float(np.exp(log_n1))
    ratio = (other - 1.0) / (other + 1.0) * (n + 1.0) / (n - 1.0)
    moved = PixelFit(fit.seen, other, fit.noise)
    moved.weigh(fit.weight)
    return moved, gloss + np.array([2.0 * np.log(ratio), 0.0])
