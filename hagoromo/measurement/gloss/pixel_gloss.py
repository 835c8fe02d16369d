"""Gloss of single pixels: for each the ln(β F₀) and ln γ of highest posterior density, its own body beside them.

Enters: observations of pixels whose n is known and a normal law that their glosses are drawn from. Leaves: the estimate
of every pixel with the information that its photographs hold. The body of a pixel is linear in its values and is
eliminated (as in `TexturedObjective`); all pixels are stepped at once (Levenberg–Marquardt). A pixel that no lamp shows
near its highlight has no information, and keeps the law's mean with the law's spread as its error.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hagoromo.least_squares import HUBER, Damping, FitStatuses, Tolerance, levenberg_marquardt
from hagoromo.measurement.gloss.lobes import Lobes
from hagoromo.measurement.observations import Observations
from hagoromo.measurement.robust_fit import GAMMA_RANGE
from hagoromo.measurement.sight import Array, Sight
from hagoromo.reflectance.torrance_sparrow import Cosines

START_WIDTHS = np.geomspace(0.35, 2.8, 7)  # of the law's γ: a lobe off by less than 1.3 keeps its overlap with the data
STARTS_WITHIN = 2.5  # standard deviations of the law that starts may lie from its mean
PIXEL_GLOSS_ROUNDS = 3  # of weights and variances that follow the model
PIXEL_GLOSS_STEPS = 25  # of a pixel, in each round
SMALLEST_DECREMENT = 1e-4  # a pixel has converged when a step would lower χ²/2 by less: 1 % of a standard error
SMALLEST_SPREAD = 1e-4  # standard deviation that keeps a law of no width invertible


@dataclass(frozen=True, eq=False)
class GlossLaw:
    """Normal law of (ln β F₀, ln γ) over the pixels of a material: mean (2,), covariance (2, 2)."""

    mean: Array
    covariance: Array

    @property
    def information(self) -> Array:
        """(2, 2) inverse of the covariance."""
        return np.asarray(np.linalg.inv(self.covariance + SMALLEST_SPREAD**2 * np.eye(2)), np.float64)


@dataclass(frozen=True, eq=False)
class PixelGloss:
    """Estimates of P pixels.

    gloss: (P, 2) ln β F₀ and ln γ. covariance: (P, 2, 2) of the posterior. information: (P, 2, 2) of the photographs
    alone; pull: (P, 2) −½ dχ²/d(gloss). body: (P, C) α c_b and its standard error. chi_square: (P,) with the weights
    of `PixelFit.weight`. converged: (P,) whether the estimate is at a maximum of the posterior.
    """

    gloss: Array
    covariance: Array
    information: Array
    pull: Array
    body: Array
    body_error: Array
    chi_square: Array
    converged: NDArray[np.bool_]


class PixelFit:
    """The least squares of many pixels at once, and its weights (N, C) = robust weight over variance.

    noise: standard deviation of the residuals, in stated standard deviations.
    """

    def __init__(self, seen: Observations, n: float, noise: float = 1.0) -> None:
        self.seen, self.n, self.noise = seen, n, noise
        self.pixels, self.pixel = np.unique(seen.pixel, return_inverse=True)
        self._lobes = Lobes(seen.sight, n)
        self._lit = seen.sight.body
        self.weigh(np.where(seen.used, 1.0 / (noise**2 * seen.noise), 0.0))

    def __len__(self) -> int:
        return len(self.pixels)

    def of(self, chosen: NDArray[np.bool_]) -> PixelFit:
        """The fit of the pixels that are `chosen` (P,), with the weights that they have."""
        seen, rows = self.seen, chosen[self.pixel]
        sight = Sight(Cosines(*(cosine[rows] for cosine in seen.sight.cosines)), seen.sight.irradiance[rows])
        keys = ("values", "noise", "gain", "used", "ceiling", "tile", "pixel")
        part = replace(seen, sight=sight, **{key: getattr(seen, key)[rows] for key in keys})
        few = PixelFit(part, self.n, self.noise)
        few.weigh(self.weight[rows])
        return few

    def with_values(self, seen: Observations) -> PixelFit:
        """The fit of other values in the same places, with the same weights."""
        other = PixelFit(seen, self.n, self.noise)
        other.weigh(self.weight)
        return other

    def solve(self, law: GlossLaw) -> PixelGloss:
        """The estimates under `law`; afterwards `weight` is that of the residuals they leave."""
        gloss, converged = self._start(law), np.zeros(len(self), bool)
        for _ in range(PIXEL_GLOSS_ROUNDS):
            self.reweigh(gloss)
            gloss, statuses = self.settled(gloss, law)
            converged = statuses.converged
        found = self.at(gloss)
        covariance = np.asarray(np.linalg.inv(found.information + law.information), np.float64)
        body_error = np.sqrt(found.body_error**2 + self._body_variance(gloss, covariance))
        return PixelGloss(
            gloss, covariance, found.information, found.pull, found.body, body_error, found.chi_square, converged
        )

    def settled(self, gloss: Array, law: GlossLaw) -> tuple[Array, FitStatuses]:
        """`gloss` (P, 2) moved to the nearest maximum of the posterior under these weights, and how that ended."""
        problem, tolerance = _Posterior(self, law), Tolerance(decrement=SMALLEST_DECREMENT)
        found = levenberg_marquardt(problem, self.at(gloss), Damping(), tolerance, PIXEL_GLOSS_STEPS)
        return found.state.gloss, found.statuses

    def reweigh(self, gloss: Array) -> None:
        """Take variances at the values expected for `gloss` (P, 2), and the robust weights of the residuals."""
        model = self.model(gloss)
        variance = self.noise**2 * self.seen.variance_at(model)
        loss = HUBER.weight((self.seen.values - model) / np.sqrt(variance))
        self.weigh(np.where(self.seen.used, loss, 0.0) / variance)

    def weigh(self, weight: Array) -> None:
        """Take `weight` (N, C), and with it the variance (P, C) of a body at a given gloss."""
        self.weight = weight
        power = self._sum(weight * self._lit**2)
        self._inverse = np.divide(1.0, power, out=np.zeros_like(power), where=power > 0.0)

    def model(self, gloss: Array) -> Array:
        """Expected values (N, C)."""
        interface = self._columns(gloss)[0]
        return self._lit * self._body_of(self.seen.values - interface)[self.pixel] + interface

    def leverage(self) -> Array:
        """(N, C) share of a value in the body of its pixel."""
        return self.weight * self._lit**2 * self._inverse[self.pixel]

    def at(self, gloss: Array) -> PixelGloss:
        """χ² and what follows from it at `gloss` (P, 2); errors and covariance are those at a given gloss."""
        columns = self._columns(gloss)
        rest = self.seen.values - columns[0]
        body = self._body_of(rest)
        deviation = rest - self._lit * body[self.pixel]
        within = [column - self._lit * self._body_of(column)[self.pixel] for column in columns]
        weighted = [self.weight * column for column in within]
        chi_square = self._sum((self.weight * deviation**2).sum(axis=1))
        pull = np.stack([self._sum((column * deviation).sum(axis=1)) for column in weighted], axis=1)
        ss, sg, gg = (self._sum((weighted[i] * within[j]).sum(axis=1)) for i, j in ((0, 0), (0, 1), (1, 1)))
        information = np.stack([ss, sg, sg, gg], axis=1).reshape(-1, 2, 2)
        return PixelGloss(
            gloss,
            np.zeros_like(information),
            information,
            pull,
            body,
            np.sqrt(self._inverse),
            chi_square,
            np.zeros(len(self), bool),
        )

    def _start(self, law: GlossLaw) -> Array:
        """(P, 2): the best of several widths, each with the strength that goes best with it."""
        spread = np.sqrt(np.diag(law.covariance)) + SMALLEST_SPREAD
        best, lowest = np.tile(law.mean, (len(self), 1)), np.full(len(self), np.inf)
        for step in np.log(START_WIDTHS):
            if abs(step) > STARTS_WITHIN * spread[1]:
                continue
            gloss = np.tile([law.mean[0], law.mean[1] + step], (len(self), 1))
            found = self.at(gloss)
            # χ² is quadratic in the strength: its minimum, kept within the law's reach
            ratio = 1.0 + found.pull[:, 0] / np.maximum(found.information[:, 0, 0], 1e-300)
            reach = STARTS_WITHIN * spread[0]
            gloss[:, 0] += np.clip(np.log(np.maximum(ratio, 1e-6)), -reach, reach)
            cost = self.at(gloss).chi_square + _beside(gloss, law)
            best, lowest = np.where((cost < lowest)[:, None], gloss, best), np.minimum(cost, lowest)
        return best

    def _columns(self, gloss: Array) -> tuple[Array, Array]:
        """The interface (N, C), which is its own slope by ln β F₀, and its slope by ln γ."""
        value, slope = self._lobes.at(gloss[self.pixel, 1])
        strength = np.exp(gloss[self.pixel, 0])[:, None]
        return strength * value, strength * slope

    def _body_variance(self, gloss: Array, covariance: Array) -> Array:
        """(P, C) what the covariance of the gloss adds to the variance of the body."""
        slopes = np.stack([self._body_of(column) for column in self._columns(gloss)], axis=-1)
        return np.einsum("pci,pij,pcj->pc", slopes, covariance, slopes)

    def _body_of(self, values: Array) -> Array:
        """(P, C) least squares of values (N, C) by the light on each pixel, 0 where a channel was not seen."""
        return self._sum(self.weight * self._lit * values) * self._inverse

    def _sum(self, values: Array) -> Array:
        """Values (N,) or (N, C) summed over the places of each pixel."""
        if values.ndim == 1:
            return np.bincount(self.pixel, values, len(self)).astype(np.float64)
        return np.stack([self._sum(column) for column in values.T], axis=1)


class _Posterior:
    """The posterior of P pixels under a law as a problem of `least_squares`; the cost is χ², with the law's part."""

    def __init__(self, fit: PixelFit, law: GlossLaw) -> None:
        self.fit, self.law, self.prior = fit, law, law.information

    def cost(self, state: PixelGloss) -> Array:
        """(P,)"""
        return state.chi_square + _beside(state.gloss, self.law)

    def decrement(self, state: PixelGloss, moving: NDArray[np.bool_]) -> Array:
        """(P,) of χ²/2, over what is not held at an end of the range of γ."""
        pull, curvature = self._equations(state)
        low, high = np.log(GAMMA_RANGE)
        log_gamma = state.gloss[:, 1]
        held = ((log_gamma <= low) & (pull[:, 1] < 0.0)) | ((log_gamma >= high) & (pull[:, 1] > 0.0))
        newton = np.linalg.solve(curvature, pull[..., None])[..., 0]
        whole = 0.5 * np.einsum("pi,pi->p", pull, newton)
        return np.where(held, 0.5 * pull[:, 0] ** 2 / curvature[:, 0, 0], whole)

    def trial(self, state: PixelGloss, damping: Array, moving: NDArray[np.bool_]) -> tuple[PixelGloss, Array]:
        """The state after a damped step, at most 1 in each coordinate."""
        pull, curvature = self._equations(state)
        damped = curvature + damping[:, None, None] * curvature * np.eye(2)
        step = np.linalg.solve(damped, pull[..., None])[..., 0]
        gloss = state.gloss + np.where(moving[:, None], np.clip(step, -1.0, 1.0), 0.0)
        gloss[:, 1] = np.clip(gloss[:, 1], *np.log(GAMMA_RANGE))
        return self.fit.at(gloss), np.linalg.norm(gloss - state.gloss, axis=1)

    def chosen(self, better: NDArray[np.bool_], trial: PixelGloss, state: PixelGloss) -> PixelGloss:
        """Of each pixel the better one."""
        return _chosen(better, trial, state)

    def gradient(self, state: PixelGloss) -> Array:
        """(P,) of χ²/2."""
        return np.linalg.norm(self._equations(state)[0], axis=1)

    def _equations(self, state: PixelGloss) -> tuple[Array, Array]:
        pull = state.pull - (state.gloss - self.law.mean) @ self.prior
        return pull, state.information + self.prior


def _beside(gloss: Array, law: GlossLaw) -> Array:
    """(P,) what the law adds to χ²."""
    off = gloss - law.mean
    return np.einsum("pi,ij,pj->p", off, law.information, off)


def _chosen(better: NDArray[np.bool_], one: PixelGloss, other: PixelGloss) -> PixelGloss:
    """Of each pixel the estimate of `one` where it is better, else that of `other`."""
    pairs = ((getattr(one, key), getattr(other, key)) for key in PixelGloss.__dataclass_fields__)
    return PixelGloss(*(np.where(better.reshape(-1, *[1] * (a.ndim - 1)), a, b) for a, b in pairs))
