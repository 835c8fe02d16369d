"""Gloss posterior: the most probable gloss of each pixel under a law of the gloss, when all else of it follows.

One least squares for two sets of unknowns: with known shape a pixel has its gloss and its body colour; with unknown
shape its normal as well. Both give the curvature and the pull of what is left when the body colour is eliminated, in
which the gloss (ln β, ln γ) stands last.

Gloss law: the normal distribution of gloss over a material with the highest likelihood of its photographs.

The likelihood of each pixel is approximated by a normal one around its estimate (Laplace), so that the integral over
its gloss has a closed form.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from hagoromo.least_squares.fit_status import FitStatus, Status
from hagoromo.least_squares.rows import SMALLEST_CURVATURE
from hagoromo.measurement.parameters import GAMMA_RANGE
from hagoromo.measurement.sight import Array

SMALLEST_SPREAD = 1e-4  # standard deviation added to a law, so that its covariance can be inverted
GLOSS = np.s_[-2:]  # places of ln β and ln γ among the unknowns of a pixel
BRIGHTEST_UNSEEN = 10.0  # peak of a pixel's lobe over its value under the lamp that comes nearest to it, at most
USUAL = 2.0  # standard deviations of ln γ below the law's mean that a pixel may have, whatever its lamps show
SMALLEST_TAIL = 1e-9  # 1/ν: below, facets are as good as Gaussian
GLOSS_LAW_STEPS = 200  # of expectation maximisation
LARGEST_CHANGE = 1e-3  # relative change of the covariance in a step: below it the search has converged


@dataclass(frozen=True, eq=False)
class GlossLaw:
    """Normal law of (ln β F₀, ln γ) over the pixels of a material: mean (2,), covariance (2, 2)."""

    mean: Array
    covariance: Array

    @property
    def information(self) -> Array:
        """(2, 2) inverse of the covariance."""
        return np.asarray(np.linalg.inv(self.covariance + SMALLEST_SPREAD**2 * np.eye(2)), np.float64)

    def loss(self, gloss: Array) -> Array:
        """(P,) contribution of gloss (P, 2) to χ²."""
        off = gloss - self.mean
        return np.einsum("pi,ij,pj->p", off, self.information, off)


@dataclass(frozen=True, eq=False)
class PixelGloss:
    """Estimates of P pixels.

    gloss: (P, 2) ln β F₀ and ln γ. covariance: (P, 2, 2) of the posterior. information: (P, 2, 2) of the photographs
    alone; score: (P, 2) −½ dχ²/d(gloss). body: (P, C) α c_b and its standard error. chi_square: (P,) with the weights
    of the fit. converged: (P,) whether the estimate is at a maximum of the posterior.
    """

    gloss: Array
    covariance: Array
    information: Array
    score: Array
    body: Array
    body_error: Array
    chi_square: Array
    converged: NDArray[np.bool_]


class GlossState(Protocol):
    """A point of P pixels."""

    @property
    def gloss(self) -> Array:
        """(P, 2) ln β and ln γ."""
        ...


State = TypeVar("State", bound=GlossState)


class GlossPixels(Protocol[State]):
    """P pixels in photographs, with Q unknowns each, the body colours eliminated."""

    def loss(self, state: State) -> Array:
        """(P,) χ², or a robust loss in its place."""
        ...

    def equations(self, state: State, prior: Array, damping: Array) -> tuple[Array, Array]:
        """Curvature (P, Q, Q) of half the loss, with `prior` (2, 2) of the gloss and a `damping` (P,) in it, and score
        (P, Q), which has no prior.
        """
        ...

    def further_decrement(self, state: State) -> Array:
        """(P,) by which the eliminated body colours, where they are not at their best, would lower half the loss."""
        ...

    def moved(
        self, state: State, step: Array, damping: Array, moving: NDArray[np.bool_], narrowest: Array
    ) -> tuple[State, Array]:
        """The state after a step (P, Q) that was damped by `damping` (P,), shortened where it is long, of the pixels
        that are moving; its length (P,). narrowest: (P,) least ln γ.
        """
        ...

    def chosen(self, better: NDArray[np.bool_], trial: State, state: State) -> State:
        """Of each pixel the better one."""
        ...


class GlossPosterior(Generic[State]):
    """The posterior of pixels under a law, as a problem of `least_squares`; the cost is half of χ² and of the law's.

    narrowest: (P,) least ln γ of each pixel, see `least_log_gamma`.
    """

    def __init__(self, pixels: GlossPixels[State], law: GlossLaw, narrowest: Array) -> None:
        self.pixels, self.law, self.prior, self.narrowest = pixels, law, law.information, narrowest

    def cost(self, state: State) -> Array:
        """(P,)"""
        return 0.5 * (self.pixels.loss(state) + self.law.loss(state.gloss))

    def decrement(self, state: State, moving: NDArray[np.bool_]) -> Array:
        """(P,) of the cost, without ln γ where it is held at a limit of its range."""
        curvature, score = self._equations(state)
        high = np.log(GAMMA_RANGE[1])
        log_gamma, pull = state.gloss[:, 1], score[:, -1]
        held = ((log_gamma <= self.narrowest) & (pull < 0.0)) | ((log_gamma >= high) & (pull > 0.0))
        whole, without = (_newton(curvature[:, :size, :size], score[:, :size]) for size in (None, -1))
        return np.where(held, without, whole) + self.pixels.further_decrement(state)

    def trial(self, state: State, damping: Array, moving: NDArray[np.bool_]) -> tuple[State, Array]:
        """The state after a damped step of the pixels that are moving."""
        curvature, score = self._equations(state, damping)
        step = np.asarray(np.linalg.solve(curvature, score[..., None])[..., 0], np.float64)
        return self.pixels.moved(state, step, damping, moving, self.narrowest)

    def chosen(self, better: NDArray[np.bool_], trial: State, state: State) -> State:
        """Of each pixel the better one."""
        return self.pixels.chosen(better, trial, state)

    def gradient(self, state: State) -> Array:
        """(P,) of the cost by ln β and ln γ."""
        return np.linalg.norm(self._equations(state)[1][:, GLOSS], axis=1)

    def _equations(self, state: State, damping: Array | None = None) -> tuple[Array, Array]:
        size = np.zeros(len(state.gloss)) if damping is None else damping
        curvature, score = self.pixels.equations(state, self.prior, size)
        pull = score.copy()
        pull[:, GLOSS] -= (state.gloss - self.law.mean) @ self.prior
        return curvature, pull


def least_log_gamma(least_angle: Array, tail: Array | float, law: GlossLaw) -> Array:
    """(P,) least ln γ of pixels to whose highlights some lamp comes as near as the half angle `least_angle` (P,) [rad].

    A narrower lobe would be over BRIGHTEST_UNSEEN times as bright at its peak as any photograph shows it, and its
    strength a guess, which has no bound where an edge or a cast shadow is off. What is usual under the law may be in
    any case. tail: 1/ν of the facets.
    """
    tail = np.maximum(tail, SMALLEST_TAIL)
    widths = np.sqrt(np.expm1(tail * np.log(BRIGHTEST_UNSEEN)) / np.expm1(tail * np.log(2.0)))  # φ/γ where D is as low
    usual = law.mean[1] - USUAL * np.sqrt(law.covariance[1, 1])
    seen = np.log(np.maximum(least_angle, GAMMA_RANGE[0]) / widths)
    return np.clip(np.minimum(seen, usual), *np.log(GAMMA_RANGE))


def _newton(curvature: Array, score: Array) -> Array:
    """(P,) fall of the cost that an undamped step predicts."""
    step = np.linalg.solve(curvature, score[..., None])[..., 0]
    return 0.5 * np.einsum("pi,pi->p", score, step)


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
