"""Solved tails: the tail 1/ν of the facets of each pixel of a solved surface, under a normal law of the tails.

Tail and width of a pixel are known together or not at all, and what is known of a tail is far from a normal
distribution. So the gloss of every pixel is solved at each of TAILS, its likelihood is integrated over β and γ there
(Laplace), and the posterior of the tail is taken from these numbers, between which they are interpolated.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hagoromo.measurement.gloss.gloss_spread import trimmed_odds
from hagoromo.measurement.gloss.solved_pixels import SolvedPixels, State
from hagoromo.measurement.photometric.gloss_posterior import GlossLaw, PixelGloss, deviance, likeliest
from hagoromo.measurement.sight import Array

TAILS = np.array([0.0, 0.15, 0.3, 0.45, 0.65, 0.9, 1.2, 1.6, 2.2])  # 1/ν at which pixels are solved
BETWEEN = 12  # parts of each of their intervals
WIDEST_TAIL, NARROWEST_TAIL = 0.4, 0.02  # standard deviation of the law of 1/ν: at the start, and the least
TAIL_ROUNDS = 2  # of the laws of gloss and tails, which depend on each other
TAIL_LAW_STEPS = 300  # of expectation maximisation
SETTLED = 1e-4  # change of mean and deviation of the law in a step: below it the search has ended
NUMBERS = 5  # of the laws: three of the covariance of the gloss, mean and deviation of the tails


@dataclass(frozen=True)
class TailLaw:
    """Normal law of the tails 1/ν over the pixels of a material, cut off at the ends of TAILS."""

    mean: float
    deviation: float


@dataclass(frozen=True, eq=False)
class PixelTails:
    """Tails of P pixels and what goes with them.

    tail: (P,) mean of the posterior. state, own: of pixels that have this tail. covariance: (P, 3, 3) of ln β, ln γ and
    1/ν. deviance: (P,) −2 ln of the likelihood, integrated over gloss and tail.
    """

    tail: Array
    state: State
    own: PixelGloss
    covariance: Array
    deviance: Array


def pixel_tails(data: SolvedPixels, law: GlossLaw, tails: TailLaw, start: State) -> PixelTails:
    """The tails of the pixels of `data` under both laws."""
    return _Grid(data, law, start).under(tails)


def likeliest_tails(
    data: SolvedPixels, law: GlossLaw, mean: float, start: State
) -> tuple[GlossLaw, TailLaw, PixelTails]:
    """Laws of gloss and tails of highest likelihood, from tails about `mean` on, and the pixels under them."""
    tails, state = TailLaw(mean, WIDEST_TAIL), start
    for _ in range(TAIL_ROUNDS):
        grid = _Grid(data, law, state)
        tails = grid.likeliest(tails)
        found = grid.under(tails)
        state, law = found.state, likeliest(found.own, law)[0]
    return law, tails, pixel_tails(data, law, tails, state)


def tail_odds(found: PixelTails, shared: Array) -> float:
    """Logarithm of the odds of laws of gloss and tails against one gloss with χ² `shared` (P,)."""
    return trimmed_odds(0.5 * (shared - found.deviance), NUMBERS)


class _Grid:
    """The gloss of P pixels at each of TAILS, and what their photographs say of the tails between them."""

    def __init__(self, data: SolvedPixels, law: GlossLaw, start: State) -> None:
        self.data, self.law, self.state = data, law, start
        gloss, deviances = [], []
        for tail in TAILS:
            _, own = data.with_tails(np.full(len(start.loss), tail)).solve(law, start)
            gloss.append(own.gloss)
            deviances.append(deviance(own, law))
        self.gloss = np.stack(gloss, axis=1)
        parts = np.arange(BETWEEN * (len(TAILS) - 1) + 1) / BETWEEN
        self.tails = np.interp(parts, np.arange(len(TAILS)), TAILS)
        self.share = np.stack([np.interp(parts, np.arange(len(TAILS)), one) for one in np.eye(len(TAILS))], axis=1)
        from scipy.interpolate import PchipInterpolator

        self.deviance = np.asarray(PchipInterpolator(TAILS, np.stack(deviances, axis=1), axis=1)(self.tails))

    def likeliest(self, law: TailLaw) -> TailLaw:
        """The law of tails of highest likelihood near `law`, by expectation maximisation."""
        for _ in range(TAIL_LAW_STEPS):
            share = self._posterior(law)[0]
            mean = float(np.mean(share @ self.tails))
            spread = max(float(np.sqrt(np.mean(share @ (self.tails - mean) ** 2))), NARROWEST_TAIL)
            change, law = max(abs(mean - law.mean), abs(spread - law.deviation)), TailLaw(mean, spread)
            if change < SETTLED:
                break
        return law

    def under(self, law: TailLaw) -> PixelTails:
        """The pixels under a law of tails."""
        share, of_all = self._posterior(law)
        tail = share @ self.tails
        state, own = self.data.with_tails(tail).solve(self.law, self.state)
        parts = share @ self.share  # (P, T) of the posterior, at each of TAILS
        off = self.gloss - np.einsum("pt,pti->pi", parts, self.gloss)[:, None]
        covariance = np.zeros((len(tail), 3, 3))
        covariance[:, :2, :2] = own.covariance + np.einsum("pt,pti,ptj->pij", parts, off, off)
        covariance[:, :2, 2] = covariance[:, 2, :2] = np.einsum("pt,pti,pt->pi", parts, off, TAILS - tail[:, None])
        covariance[:, 2, 2] = np.einsum("pt,pt->p", share, (self.tails - tail[:, None]) ** 2)
        return PixelTails(tail, state, own, covariance, of_all)

    def _posterior(self, law: TailLaw) -> tuple[Array, Array]:
        """(P, F) of the tails, and −2 ln of their integral (P,)."""
        prior = -0.5 * ((self.tails - law.mean) / law.deviation) ** 2 + np.log(np.gradient(self.tails))
        prior -= np.log(np.exp(prior - prior.max()).sum()) + prior.max()
        logarithm = prior - 0.5 * self.deviance
        most = logarithm.max(axis=1, keepdims=True)
        share = np.exp(logarithm - most)
        total = share.sum(axis=1, keepdims=True)
        return share / total, -2.0 * (np.log(total) + most)[:, 0]
