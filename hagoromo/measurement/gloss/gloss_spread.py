"""Gloss spread: by how much gloss varies over a material, and whether there is evidence for it.

Model: the glosses (ln β F₀, ln γ) of the pixels follow a normal law, whose mean and covariance maximise the likelihood
of the photographs (empirical Bayes). The evidence is the gain of ln likelihood of that law over one gloss for all,
less ½ ln P for each of the covariance's three numbers: the criterion of Schwarz (1978), as for the albedo.

The refractive index of a material whose gloss varies over its pixels.

Gloss that varies over the surface is correlated with the angles, and this must not be attributed to Fresnel's law. So n
is estimated from the values of each pixel under several lamps, with its gloss free. The search is repeated on simulated
copies of the photographs with independent noise, and the bias found there is subtracted.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hagoromo.least_squares.fit_status import FitStatus, Status
from hagoromo.least_squares.levenberg_marquardt import Damping, SingleProblem, Tolerance, levenberg_marquardt
from hagoromo.least_squares.loss import NORMAL_95, NORMAL_MEDIAN
from hagoromo.measurement.gloss.pixel_gloss import LobeShape, PixelGlossFit
from hagoromo.measurement.material.estimate import PRIOR_N
from hagoromo.measurement.material.uncertainty import RELATIVE_LIMIT
from hagoromo.measurement.observations import Observations
from hagoromo.measurement.parameters import GAMMA_RANGE, N_RANGE
from hagoromo.measurement.photometric.gloss_posterior import (
    GlossLaw,
    PixelGloss,
    covariance_of_mean,
    deviance,
    likeliest,
)
from hagoromo.measurement.sight import Array

FEWEST_PIXELS = 30
DECISIVE_LOG_ODDS = 5.0  # ln of the odds above which the gloss is taken to vary
EXPLAINED = 0.5  # smallest share of the lack of fit that gloss per pixel must explain
WIDEST = 0.7  # standard deviation of ln β F₀ and ln γ at the start: a factor of two
GLOSS_SPREAD_ROUNDS = 4  # of estimates and law, which depend on each other
SHARED_GLOSS_ROUNDS, SHARED_GLOSS_STEPS = 3, 12  # of the fit of one gloss for all pixels
SHARED_GLOSS_STANDSTILL = 1e-6  # size of a step in ln β F₀ and ln γ below which that fit has converged
TRIMMED = 0.02  # share of the pixels that may be outliers: edges, dust
LARGEST_LEVERAGE = 0.9  # values of larger leverage carry no information on the noise
NUMBERS = 3  # of the covariance
FEWEST_INFORMATIVE = 10  # informative pixels
LARGEST_PIXEL_ERROR = 0.15  # standard error of ln β and ln γ, from the photographs alone, of an informative pixel
FLAT_PRIOR = 1e3  # standard deviation of a prior that has no effect
NODES = 0.15 * np.arange(-3, 4)  # of ln(n − 1), around the estimate: a parabola through them gives n and its error
INDEX_SEARCH_TURNS = 4  # largest number of parabolas
COPIES, SEED = 4, 0  # simulated copies of the photographs, and the seed of their noise


@dataclass(frozen=True, eq=False)
class GlossSpread:
    """Variation of gloss over the pixels of a material.

    law: of (ln β F₀, ln γ). log_evidence: ln odds of the law against one gloss. noise: standard deviation of the
    residuals in units of the stated one, at least 1. chi_square: per degree of freedom, of one gloss and of gloss per
    pixel. index: n of all pixels. covariance: (2, 2) of the law's mean. statuses: how the fits of the law and of one
    gloss ended. converged: share of the pixels whose fit converged. follows_angles: whether the variation depends on
    the angles at which pixels are viewed, and not on the pixels.
    """

    law: GlossLaw
    log_evidence: float
    noise: float
    chi_square: tuple[float, float]
    index: Index
    covariance: Array
    statuses: tuple[FitStatus, ...]
    converged: float = 1.0
    follows_angles: bool = False

    @property
    def varies(self) -> bool:
        """Whether there is evidence for the variation."""
        return self.log_evidence > DECISIVE_LOG_ODDS and self.explained >= EXPLAINED and not self.follows_angles

    @property
    def explained(self) -> float:
        """Share of the lack of fit of one gloss that gloss per pixel explains; low if the normals are wrong."""
        shared, own = self.chi_square
        return (shared - own) / max(shared - min(own, 1.0), 1e-9)

    @property
    def spread(self) -> Array:
        """(2,) standard deviations of ln β and ln γ."""
        return np.sqrt(np.diag(self.law.covariance))

    @property
    def n(self) -> float:
        """Refractive index of all pixels."""
        return self.index.n

    @property
    def beta_per_strength(self) -> float:
        """β over β F₀."""
        return ((self.n + 1.0) / (self.n - 1.0)) ** 2

    @property
    def variance_by_n(self) -> Array:
        """(2,) contribution of the error of n to the variances of ln β and ln γ, common to all pixels."""
        return self.index.variance * np.array([4.0 / (self.n + 1.0), 0.0]) ** 2


def gloss_spread(
    observations: Observations, start: Array, n: float, is_given: bool, shape: LobeShape | None = None
) -> GlossSpread | None:
    """The spread of gloss over the pixels `observations`; None where they are too few.

    start: (2,) ln(β F₀) and ln γ of one gloss for all pixels. n: their refractive index: fixed where it `is_given`,
    else the start of a search, since the fit of one gloss to pixels that differ biases n. shape: of their lobes; None:
    Gaussian facets and a neutral interface.
    """
    fit = PixelGlossFit(observations, n, shape=shape)
    if len(fit) < FEWEST_PIXELS:
        return None
    shared, _ = _shared(fit, start)  # a start: whether it converged does not matter
    estimates, wide = fit.evaluate(shared), GlossLaw(shared[0], WIDEST**2 * np.eye(2))
    law, status = likeliest(estimates, wide)
    first = log_odds(
        estimates, law, estimates.chi_square
    )  # from the slopes at the shared gloss: cheap, and enough to reject
    if first < DECISIVE_LOG_ODDS:
        chi_square = _per_freedom(fit, shared, 2)
        return GlossSpread(law, first, 1.0, (chi_square, chi_square), Index(n), np.zeros((2, 2)), (status,))
    law, noise, index = wide, 1.0, Index(n)
    for turn in range(GLOSS_SPREAD_ROUNDS):
        fit = PixelGlossFit(observations, index.n, noise, shape)
        estimates = fit.solve(law)
        (law, status), noise = likeliest(estimates, law), max(noise * _scale(fit, estimates.gloss), 1.0)
        if turn == GLOSS_SPREAD_ROUNDS // 2 and not is_given:
            last, index = index.n, refractive_index(fit, estimates, index.n)
            ratio = (index.n - 1.0) / (index.n + 1.0) * (last + 1.0) / (last - 1.0)
            law = GlossLaw(law.mean + 2.0 * np.log(ratio) * np.array([1.0, 0.0]), law.covariance)  # at the same β
    fit = PixelGlossFit(observations, index.n, noise, shape)
    estimates = fit.solve(law)
    one = PixelGlossFit(observations, n, noise, shape)
    one.weigh(fit.weight)
    best, shared_status = _shared(one, shared[0], reweighed=False)
    parameters = int(
        np.einsum("pij,pji->", estimates.covariance, estimates.information)
    )  # effective number of parameters
    return GlossSpread(
        law,
        log_odds(estimates, law, one.evaluate(best).chi_square),
        noise,
        (_per_freedom(one, best, 2), _per_freedom(fit, estimates.gloss, parameters)),
        index,
        covariance_of_mean(estimates, law),
        (status, shared_status),
        float(np.mean(estimates.converged)),
    )


def _shared(fit: PixelGlossFit, start: Array, reweighed: bool = True) -> tuple[Array, FitStatus]:
    """(P, 2) the one gloss that fits all pixels best, and how the fit ended.

    Its robust weights are its own if `reweighed`, else those of `fit`.
    """
    gloss, damping = np.asarray(start, np.float64), Damping(most=np.inf)
    status = FitStatus(Status.OUT_OF_STEPS, 0)
    for _ in range(SHARED_GLOSS_ROUNDS if reweighed else 1):
        if reweighed:
            fit.reweigh(np.tile(gloss, (len(fit), 1)))
        tolerance = Tolerance(step=SHARED_GLOSS_STANDSTILL)
        solution = levenberg_marquardt(
            SingleProblem(), _SharedGloss(fit, gloss), damping, tolerance, SHARED_GLOSS_STEPS
        )
        gloss, damping, status = (
            solution.state.gloss,
            replace(damping, start=float(solution.damping[0])),
            solution.status,
        )
    return np.tile(gloss, (len(fit), 1)), status


class _SharedGloss:
    """One gloss (2,) for all pixels of `fit`: a point of the fit by `least_squares`."""

    def __init__(self, fit: PixelGlossFit, gloss: Array) -> None:
        self.fit, self.gloss = fit, gloss
        self.each = fit.evaluate(np.tile(gloss, (len(fit), 1)))
        self.cost = self.each.chi_square.sum()

    @property
    def gradient(self) -> float:
        """Norm of the slope of χ²/2."""
        return float(np.linalg.norm(self.each.score.sum(axis=0)))

    def trial(self, damping: float) -> tuple[_SharedGloss, float]:
        """The point after a damped step of at most 0.5 in each coordinate, and the size of the step before that."""
        curvature = self.each.information.sum(axis=0)
        step = np.linalg.lstsq(curvature + damping * np.diag(np.diag(curvature)), self.each.score.sum(axis=0))[0]
        gloss = self.gloss + np.clip(step, -0.5, 0.5)
        gloss[1] = np.clip(gloss[1], *np.log(GAMMA_RANGE))
        return _SharedGloss(self.fit, gloss), float(np.abs(step).max())


def log_odds(estimates: PixelGloss, law: GlossLaw, shared: Array) -> float:
    """Logarithm of the odds of `law` against one gloss with χ² `shared` (P,).

    See `trimmed_odds`.
    """
    return trimmed_odds(0.5 * (shared - deviance(estimates, law)), NUMBERS)


def trimmed_odds(gain: Array, numbers: int) -> float:
    """Logarithm of the odds of a law of so many `numbers` that raises ln of the likelihood of P pixels by `gain` (P,).

    The TRIMMED share of the pixels with the largest gains is excluded (Schwarz 1978).
    """
    trimmed = np.sort(gain)[: int(np.ceil(len(gain) * (1.0 - TRIMMED)))]
    return float(trimmed.sum() - 0.5 * numbers * np.log(len(gain)))


def _scale(fit: PixelGlossFit, gloss: Array) -> float:
    """Robust standard deviation of the residuals in units of those of `fit`, corrected for leverage of the bodies."""
    model = fit.model(gloss)
    squared = (fit.observations.values - model) ** 2 / (fit.noise**2 * fit.observations.variance_at(model))
    left = 1.0 - fit.leverage()
    known = fit.observations.used & (left > 1.0 - LARGEST_LEVERAGE)
    return float(np.sqrt(np.median((squared / np.maximum(left, 0.01))[known]) / NORMAL_MEDIAN)) if known.any() else 1.0


def _per_freedom(fit: PixelGlossFit, gloss: Array, numbers: int) -> float:
    """χ² per degree of freedom at gloss (P, 2), by stated variances; numbers: fitted in addition to the bodies."""
    model, used = fit.model(gloss), fit.observations.used
    squared = ((fit.observations.values - model) ** 2 / fit.observations.variance_at(model))[used]
    return float(squared.sum() / max(squared.size - fit.leverage()[used].sum() - numbers, 1.0))


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
    if np.sum(informative) < FEWEST_INFORMATIVE:
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
