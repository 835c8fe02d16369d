"""Pixel gloss: ln(β F₀) and ln γ of highest posterior density for each pixel, with its own body colour.

Enters: observations of pixels whose n is known, and a normal law as the prior of their glosses. Leaves: the estimate of
every pixel with the information in its photographs. The body of a pixel is linear in its values and is eliminated (as
in `AlbedoVariationObjective`); all pixels are fitted at once (Levenberg–Marquardt). A pixel that no lamp shows near its
highlight has no information: its estimate is the mean of the law, with the spread of the law as its error.

Lobes: the interface value of each sample for its own facet width, at one refractive index.

The width γ enters eq. (3) only through the facet density D. So irradiance, F, G and cosθ_r are evaluated once, with
flat facets, and D is multiplied in for any γ.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hagoromo.least_squares.fit_status import FitStatuses
from hagoromo.least_squares.levenberg_marquardt import Damping, Tolerance, levenberg_marquardt
from hagoromo.least_squares.loss import HUBER
from hagoromo.measurement.facets import facet_density
from hagoromo.measurement.observations import Observations
from hagoromo.measurement.parameters import GAMMA_RANGE
from hagoromo.measurement.photometric.gloss_posterior import (
    SMALLEST_SPREAD,
    GlossLaw,
    GlossPosterior,
    PixelGloss,
    least_log_gamma,
)
from hagoromo.measurement.photometric.reading import PixelBodies
from hagoromo.measurement.sight import Array, Sight
from hagoromo.reflectance.facets import GAUSSIAN
from hagoromo.reflectance.material.material_estimate import MaterialEstimate
from hagoromo.reflectance.torrance_sparrow import Cosines

START_WIDTHS = np.geomspace(0.35, 2.8, 7)  # times the law's γ: a start within a factor of 1.3 overlaps with the data
STARTS_WITHIN = 2.5  # standard deviations of the law around its mean in which starts lie
PIXEL_GLOSS_ROUNDS = 3  # of weights and variances, which depend on the model
PIXEL_GLOSS_STEPS = 25  # of a pixel, in each round
SMALLEST_DECREMENT = 1e-4  # of χ²/2: a pixel whose next step would lower it by less has converged (1 % of an error)
LONGEST_GLOSS_STEP = 1.0  # of ln β and ln γ each
FLAT = np.log(1e3)  # ln γ at which every facet density is 1


class PixelGlossFit:
    """The least squares of many pixels at once, and its weights (N, C) = robust weight over variance.

    noise: standard deviation of the residuals, in stated standard deviations.
    """

    def __init__(
        self, observations: Observations, n: float, noise: float = 1.0, shape: LobeShape | None = None
    ) -> None:
        self.observations, self.n, self.noise, self.shape = observations, n, noise, shape
        self.pixels, self.pixel = np.unique(observations.pixel, return_inverse=True)
        self._lobes = SampleLobes(observations.sight, n, shape)
        self.weigh(np.where(observations.used, 1.0 / (noise**2 * observations.noise), 0.0))

    def __len__(self) -> int:
        return len(self.pixels)

    def of(self, chosen: NDArray[np.bool_]) -> PixelGlossFit:
        """The fit of the pixels that are `chosen` (P,), with their present weights."""
        observations, rows = self.observations, chosen[self.pixel]
        few = PixelGlossFit(observations.of(rows), self.n, self.noise, self.shape)
        few.weigh(self.weight[rows])
        return few

    def with_values(self, observations: Observations) -> PixelGlossFit:
        """The fit of other values of the same samples, with the same weights."""
        other = PixelGlossFit(observations, self.n, self.noise, self.shape)
        other.weigh(self.weight)
        return other

    def solve(self, law: GlossLaw) -> PixelGloss:
        """The estimates under `law`; `weight` is then that of their residuals."""
        gloss, converged = self._start(law), np.zeros(len(self), bool)
        for _ in range(PIXEL_GLOSS_ROUNDS):
            self.reweigh(gloss)
            gloss, statuses = self.settled(gloss, law)
            converged = statuses.converged
        estimates = self.evaluate(gloss)
        covariance = np.asarray(np.linalg.inv(estimates.information + law.information), np.float64)
        body_error = np.sqrt(estimates.body_error**2 + self._body_variance(gloss, covariance))
        return PixelGloss(
            gloss,
            covariance,
            estimates.information,
            estimates.score,
            estimates.body,
            body_error,
            estimates.chi_square,
            converged,
        )

    def settled(self, gloss: Array, law: GlossLaw) -> tuple[Array, FitStatuses]:
        """`gloss` (P, 2) moved to the nearest maximum of the posterior at fixed weights, and how that ended."""
        problem, tolerance = GlossPosterior(self, law, self._narrowest(law)), Tolerance(decrement=SMALLEST_DECREMENT)
        solution = levenberg_marquardt(problem, self.evaluate(gloss), Damping(), tolerance, PIXEL_GLOSS_STEPS)
        return solution.state.gloss, solution.statuses

    def reweigh(self, gloss: Array) -> None:
        """Set the weights: variances at the values expected for `gloss` (P, 2), times Huber's weights."""
        model = self.model(gloss)
        variance = self.noise**2 * self.observations.variance_at(model)
        loss = HUBER.weight((self.observations.values - model) / np.sqrt(variance))
        self.weigh(np.where(self.observations.used, loss, 0.0) / variance)

    def weigh(self, weight: Array) -> None:
        """Set `weight` (N, C), and with it the bodies that follow at a given gloss."""
        self.weight = weight
        self.bodies = PixelBodies(self.pixel, self.observations.sight.body, weight)

    def model(self, gloss: Array) -> Array:
        """Expected values (N, C)."""
        interface = self._columns(gloss)[0]
        return self.bodies.light(self.observations.values - interface) + interface

    def leverage(self) -> Array:
        """(N, C) leverage of a value in the body of its pixel."""
        return self.bodies.leverage()

    def evaluate(self, gloss: Array) -> PixelGloss:
        """χ², its derivatives and the body at `gloss` (P, 2); body errors and covariance are those at fixed gloss."""
        columns = self._columns(gloss)
        rest = self.observations.values - columns[0]
        bodies, sums = self.bodies, self.bodies.sums
        body = bodies.of(rest)
        deviation = rest - bodies.lit * body[self.pixel]
        within = [column - bodies.light(column) for column in columns]
        weighted = [self.weight * column for column in within]
        chi_square = sums((self.weight * deviation**2).sum(axis=1))
        score = np.stack([sums((column * deviation).sum(axis=1)) for column in weighted], axis=1)
        ss, sg, gg = (sums((weighted[i] * within[j]).sum(axis=1)) for i, j in ((0, 0), (0, 1), (1, 1)))
        information = np.stack([ss, sg, sg, gg], axis=1).reshape(-1, 2, 2)
        return PixelGloss(
            gloss,
            np.zeros_like(information),
            information,
            score,
            body,
            np.sqrt(bodies.variance),
            chi_square,
            np.zeros(len(self), bool),
        )

    def loss(self, state: PixelGloss) -> Array:
        """(P,) χ² at fixed weights."""
        return state.chi_square

    def equations(self, state: PixelGloss, prior: Array, damping: Array) -> tuple[Array, Array]:
        """See `GlossPixels`; the prior is damped, too."""
        curvature = state.information + prior
        return curvature + damping[:, None, None] * curvature * np.eye(2), state.score

    def further_decrement(self, state: PixelGloss) -> Array:
        """None: the body colours are at their best."""
        return np.zeros(len(self))

    def moved(
        self, state: PixelGloss, step: Array, damping: Array, moving: NDArray[np.bool_], narrowest: Array
    ) -> tuple[PixelGloss, Array]:
        """The state after a step of the pixels that are moving, and its length (P,)."""
        limit = LONGEST_GLOSS_STEP
        gloss = state.gloss + np.where(moving[:, None], np.clip(step, -limit, limit), 0.0)
        gloss[:, 1] = np.clip(gloss[:, 1], narrowest, np.log(GAMMA_RANGE[1]))
        return self.evaluate(gloss), np.linalg.norm(gloss - state.gloss, axis=1)

    def chosen(self, better: NDArray[np.bool_], trial: PixelGloss, state: PixelGloss) -> PixelGloss:
        """Of each pixel the better one."""
        pairs = ((getattr(trial, key), getattr(state, key)) for key in PixelGloss.__dataclass_fields__)
        return PixelGloss(*(np.where(better.reshape(-1, *[1] * (a.ndim - 1)), a, b) for a, b in pairs))

    def _start(self, law: GlossLaw) -> Array:
        """(P, 2): the best of several widths, each with its best strength."""
        spread = np.sqrt(np.diag(law.covariance)) + SMALLEST_SPREAD
        least = self._narrowest(law)
        best, lowest = np.tile(law.mean, (len(self), 1)), np.full(len(self), np.inf)
        for step in np.log(START_WIDTHS):
            if abs(step) > STARTS_WITHIN * spread[1]:
                continue
            gloss = np.tile([law.mean[0], law.mean[1] + step], (len(self), 1))
            gloss[:, 1] = np.maximum(gloss[:, 1], least)
            estimates = self.evaluate(gloss)
            # χ² is quadratic in the strength: take its minimum, within STARTS_WITHIN of the law
            ratio = 1.0 + estimates.score[:, 0] / np.maximum(estimates.information[:, 0, 0], 1e-300)
            reach = STARTS_WITHIN * spread[0]
            gloss[:, 0] += np.clip(np.log(np.maximum(ratio, 1e-6)), -reach, reach)
            cost = self.evaluate(gloss).chi_square + law.loss(gloss)
            best, lowest = np.where((cost < lowest)[:, None], gloss, best), np.minimum(cost, lowest)
        return best

    def _narrowest(self, law: GlossLaw) -> Array:
        """(P,) least ln γ, by the samples that count."""
        angle = np.full(len(self), np.pi)
        counts = (self.weight > 0.0).any(axis=1)
        np.minimum.at(angle, self.pixel[counts], self._lobes.least_angle[counts])
        return least_log_gamma(angle, self._lobes.most_tail, law)

    def _columns(self, gloss: Array) -> tuple[Array, Array]:
        """The interface (N, C), which is its own slope by ln β F₀, and its slope by ln γ."""
        value, slope = self._lobes.evaluate(gloss[self.pixel, 1])
        strength = np.exp(gloss[self.pixel, 0])[:, None]
        return strength * value, strength * slope

    def _body_variance(self, gloss: Array, covariance: Array) -> Array:
        """(P, C) contribution of the covariance of the gloss to the variance of the body."""
        slopes = np.stack([self.bodies.of(column) for column in self._columns(gloss)], axis=-1)
        return np.einsum("pci,pij,pcj->pc", slopes, covariance, slopes)


@dataclass(frozen=True)
class LobeShape:
    """What all pixels of a material share beside n: ν of the tails of its facets, and its interface colour of mean 1.

    nu: one number, or one of each of N samples (N,). colour: one number per channel, none for a neutral interface.
    """

    nu: float | Array = GAUSSIAN
    colour: tuple[float, ...] = ()

    @classmethod
    def of(cls, material: MaterialEstimate) -> LobeShape:
        """That of a material."""
        return cls(material.nu, tuple(material.interface_colour))


class SampleLobes:
    """The interface of N samples under L lamps, each with its own ln γ. least_angle: (N,) to a highlight [rad]."""

    def __init__(self, sight: Sight, n: float, shape: LobeShape | None = None) -> None:
        shape = LobeShape() if shape is None else shape
        log_n1, self._tail = np.array([np.log(n - 1.0)]), np.array(1.0 / shape.nu)
        colour = np.array(shape.colour) if shape.colour else np.ones(sight.irradiance.shape[2])
        self._flat, self._angle2, self.least_angle = [], [], sight.least_half_angle
        for lamp in range(sight.irradiance.shape[1]):
            one = Cosines(*(cosine[:, lamp : lamp + 1] for cosine in sight.cosines))
            flat = Sight(one, sight.irradiance[:, lamp : lamp + 1]).interface(np.array([FLAT]), log_n1)[0][0]
            self._flat.append(flat * colour)
            self._angle2.append(np.arccos(np.clip(one.half[:, 0], -1.0, 1.0)) ** 2)

    @property
    def most_tail(self) -> float:
        """Largest 1/ν of the samples."""
        return float(np.max(self._tail))

    def evaluate(self, log_gamma: Array) -> tuple[Array, Array]:
        """Value per unit of β F₀ at log_gamma (N,), and its derivative by ln γ: two (N, C)."""
        value, slope = np.zeros_like(self._flat[0]), np.zeros_like(self._flat[0])
        for flat, angle2 in zip(self._flat, self._angle2, strict=True):
            density = facet_density(angle2, log_gamma, self._tail, with_tail=False)
            value += flat * density.value[:, None]
            slope += flat * density.by_log_gamma[:, None]
        return value, slope
