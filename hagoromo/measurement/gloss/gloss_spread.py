"""Gloss that varies over a material: by how much, and whether the data ask for it at all.

The glosses of the pixels are drawn from a normal law of (ln β F₀, ln γ), whose mean and covariance are those that make
the photographs most likely (empirical Bayes). The evidence is the gain of ln likelihood by that law over one gloss for
all, less ½ ln P for each of the covariance's three numbers: the criterion of Schwarz (1978), as for the body's texture.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hagoromo.least_squares import (
    NORMAL_MEDIAN,
    Damping,
    FitStatus,
    SingleProblem,
    Status,
    Tolerance,
    levenberg_marquardt,
)
from hagoromo.measurement.gloss.gloss_index import Index, refractive_index
from hagoromo.measurement.gloss.gloss_law import covariance_of_mean, lack, likeliest
from hagoromo.measurement.gloss.pixel_gloss import GlossLaw, PixelFit, PixelGloss
from hagoromo.measurement.observations import Observations
from hagoromo.measurement.robust_fit import GAMMA_RANGE
from hagoromo.measurement.sight import Array

FEWEST_PIXELS = 30
DECISIVE = 5.0  # ln of the odds from which on the gloss is taken to vary
EXPLAINED = 0.5  # of what one gloss leaves beyond the noise: where less is, it is not the gloss that varies
WIDEST = 0.7  # standard deviation of ln β F₀ and ln γ that the search begins with: a factor of two
GLOSS_SPREAD_ROUNDS = 4  # of estimates and law that follow from each other
SHARED_GLOSS_ROUNDS, SHARED_GLOSS_STEPS = 3, 12  # of the gloss that all pixels share
SHARED_GLOSS_STANDSTILL = 1e-6  # size of a step in ln β F₀ and ln γ that ends it
TRIMMED = 0.02  # share of the pixels that may be anything: edges, dust
FARTHEST = 0.9  # leverage beyond which a value says nothing of the noise
NUMBERS = 3  # of the covariance


@dataclass(frozen=True, eq=False)
class GlossSpread:
    """How gloss varies over the pixels of a material.

    law: of (ln β F₀, ln γ). log_evidence: ln odds for it against one gloss. noise: standard deviation of the residuals
    in stated ones, 1 at least. chi_square: per degree of freedom, of one gloss and of each pixel's own. index: n
    of all pixels. covariance: (2, 2) of the law's mean. statuses: how the fits of the law and of one
    gloss ended. converged: share of the pixels whose gloss did. follows_angles: whether the variation is one of the
    angles that pixels are seen under, not of the pixels.
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
        """Whether the data ask for it."""
        return self.log_evidence > DECISIVE and self.explained >= EXPLAINED and not self.follows_angles

    @property
    def explained(self) -> float:
        """Share of what one gloss leaves beyond the noise that each pixel's own takes away: less for wrong normals."""
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
        """(2,) what the error of n gives to the variances of ln β and ln γ of every pixel alike."""
        return self.index.variance * np.array([4.0 / (self.n + 1.0), 0.0]) ** 2


def gloss_spread(seen: Observations, start: Array, n: float, is_given: bool) -> GlossSpread | None:
    """The spread of gloss over the pixels `seen`; None where they are too few.

    start: (2,) ln(β F₀) and ln γ that all pixels share at first. n: of all of them, as one gloss gave it or, where it
    `is_given`, to keep: one gloss for pixels that differ shifts n.
    """
    fit = PixelFit(seen, n)
    if len(fit) < FEWEST_PIXELS:
        return None
    shared, _ = _shared(fit, start)  # a start: its rounds are not judged
    found, wide = fit.at(shared), GlossLaw(shared[0], WIDEST**2 * np.eye(2))
    law, status = likeliest(found, wide)
    first = _gain(found, law, found.chi_square)  # by the slopes at the shared gloss: cheap, and enough to say no
    if first < DECISIVE:
        chi_square = _per_freedom(fit, shared, 2)
        return GlossSpread(law, first, 1.0, (chi_square, chi_square), Index(n), np.zeros((2, 2)), (status,))
    law, noise, index = wide, 1.0, Index(n)
    for turn in range(GLOSS_SPREAD_ROUNDS):
        fit = PixelFit(seen, index.n, noise)
        found = fit.solve(law)
        (law, status), noise = likeliest(found, law), max(noise * _scale(fit, found.gloss), 1.0)
        if turn == GLOSS_SPREAD_ROUNDS // 2 and not is_given:
            last, index = index.n, refractive_index(fit, found, index.n)
            ratio = (index.n - 1.0) / (index.n + 1.0) * (last + 1.0) / (last - 1.0)
            law = GlossLaw(law.mean + 2.0 * np.log(ratio) * np.array([1.0, 0.0]), law.covariance)  # β stays
    fit = PixelFit(seen, index.n, noise)
    found = fit.solve(law)
    one = PixelFit(seen, n, noise)
    one.weigh(fit.weight)
    best, of_shared = _shared(one, shared[0], reweighed=False)
    taken = int(np.einsum("pij,pji->", found.covariance, found.information))  # numbers that the photographs told
    return GlossSpread(
        law,
        _gain(found, law, one.at(best).chi_square),
        noise,
        (_per_freedom(one, best, 2), _per_freedom(fit, found.gloss, taken)),
        index,
        covariance_of_mean(found, law),
        (status, of_shared),
        float(np.mean(found.converged)),
    )


def _shared(fit: PixelFit, start: Array, reweighed: bool = True) -> tuple[Array, FitStatus]:
    """(P, 2) the one gloss that goes best with all pixels, and how the fit ended.

    Its robust weights are its own or those of `fit`.
    """
    gloss, damping = np.asarray(start, np.float64), Damping(most=np.inf)
    status = FitStatus(Status.OUT_OF_STEPS, 0)
    for _ in range(SHARED_GLOSS_ROUNDS if reweighed else 1):
        if reweighed:
            fit.reweigh(np.tile(gloss, (len(fit), 1)))
        tolerance = Tolerance(step=SHARED_GLOSS_STANDSTILL)
        found = levenberg_marquardt(SingleProblem(), _SharedGloss(fit, gloss), damping, tolerance, SHARED_GLOSS_STEPS)
        gloss, damping, status = found.state.gloss, replace(damping, start=float(found.damping[0])), found.status
    return np.tile(gloss, (len(fit), 1)), status


class _SharedGloss:
    """One gloss (2,) for all pixels of `fit`: a point of the fit by `least_squares`."""

    def __init__(self, fit: PixelFit, gloss: Array) -> None:
        self.fit, self.gloss = fit, gloss
        self.each = fit.at(np.tile(gloss, (len(fit), 1)))
        self.cost = self.each.chi_square.sum()

    @property
    def gradient(self) -> float:
        """Norm of the slope of χ²/2."""
        return float(np.linalg.norm(self.each.pull.sum(axis=0)))

    def trial(self, damping: float) -> tuple[_SharedGloss, float]:
        """The point after a damped step of at most 0.5 in each coordinate, and the size of the step before that."""
        curvature = self.each.information.sum(axis=0)
        step = np.linalg.lstsq(curvature + damping * np.diag(np.diag(curvature)), self.each.pull.sum(axis=0))[0]
        gloss = self.gloss + np.clip(step, -0.5, 0.5)
        gloss[1] = np.clip(gloss[1], *np.log(GAMMA_RANGE))
        return _SharedGloss(self.fit, gloss), float(np.abs(step).max())


def _gain(found: PixelGloss, law: GlossLaw, shared: Array) -> float:
    """ln odds for `law` against one gloss, of χ² `shared` (P,).

    The TRIMMED share of the pixels that speaks most for it is left out.
    """
    gain = np.sort(0.5 * (shared - lack(found, law)))
    kept = gain[: int(np.ceil(len(gain) * (1.0 - TRIMMED)))]
    return float(kept.sum() - 0.5 * NUMBERS * np.log(len(gain)))


def _scale(fit: PixelFit, gloss: Array) -> float:
    """Robust standard deviation of the residuals, in those of `fit`, what the bodies took up of them given back."""
    model = fit.model(gloss)
    squared = (fit.seen.values - model) ** 2 / (fit.noise**2 * fit.seen.variance_at(model))
    left = 1.0 - fit.leverage()
    known = fit.seen.used & (left > 1.0 - FARTHEST)
    return float(np.sqrt(np.median((squared / np.maximum(left, 0.01))[known]) / NORMAL_MEDIAN)) if known.any() else 1.0


def _per_freedom(fit: PixelFit, gloss: Array, numbers: int) -> float:
    """χ² per degree of freedom with gloss (P, 2), by stated variances; numbers: fitted beside each pixel's body."""
    model, used = fit.model(gloss), fit.seen.used
    squared = ((fit.seen.values - model) ** 2 / fit.seen.variance_at(model))[used]
    return float(squared.sum() / max(squared.size - fit.leverage()[used].sum() - numbers, 1.0))
