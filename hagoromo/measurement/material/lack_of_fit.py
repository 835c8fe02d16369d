"""Lack of fit: a test whether the residuals of a material's fit still depend on the angles.

Two kinds of test; the smallest p-value counts, times their number (Bonferroni):
* Score test (Rao 1948, with the variance of White 1982). The model is extended where it is a choice: the facet density
  may have another peak, other flanks or other tails than those that were fitted, and the body may follow squares of
  cosθ_i and cosθ_r. If the model is right, the gradient of the fit by those extensions is noise. Its variance is
  estimated from the residuals, summed over each pixel.
* Runs test (Wald & Wolfowitz 1940). Ordered by φ, θ_i or θ_r, the signs of the residuals change as often as by chance.
Neither test responds to a wrong noise level or to a body colour that varies between pixels.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import f as f_distribution
from scipy.stats import norm as normal

from hagoromo.measurement.material.sandwich import MaterialFit
from hagoromo.measurement.parameters import LOG_GAMMA, LOG_N1, STRENGTH, TAIL, channels_of, interface_colour
from hagoromo.measurement.sight import Array, Sight
from hagoromo.reflectance.facets import LN2

LEVEL = 1e-4  # rate of false alarms: a capture has several materials
FLAT = np.log(1e3)  # ln γ at which every facet density is 1
FEWEST = 10.0  # smallest effective number of pixels that an extension of the model must depend on
FEWEST_SIGNS = 20
LOBE = 4.0  # φ/γ up to which the highlight reaches
BODY = tuple(f"the body is not Lambert's: it varies with {of} beside the model" for of in ("θ_i", "θ_i", "θ_r", "θ_r"))
FACETS = ("another peak", "other flanks", "other tails", "other far tails")


@dataclass(frozen=True)
class LackOfFit:
    """Test of the model's shape over the angles.

    p_value: of the most significant test; `statistic` is its F with `degrees` (freedoms, pixels − freedoms) of freedom,
    or the z of too few runs among `degrees` (0, values). rejected: p_value below LEVEL. rms: relative size of the
    part that the model misses, root mean square over the values. where: in words.
    """

    statistic: float
    degrees: tuple[int, int]
    p_value: float
    rejected: bool
    rms: float
    where: str

    def record(self) -> dict[str, Any]:
        """The entry in materials.json."""
        return asdict(self) | {"degrees": list(self.degrees), "level": LEVEL}

    def remark(self) -> str:
        """One line for a report."""
        freedoms, rest = self.degrees
        figure = f"F({freedoms}, {rest}) = {self.statistic:.3g}" if freedoms else f"z = {self.statistic:.3g} of {rest}"
        return (
            f"lack of fit: {self.where}; this is not a dichromatic Torrance–Sparrow reflectance, and the model misses "
            f"{100 * self.rms:.2g} % of the values rms ({figure}, p {_p_text(self.p_value)}, level {LEVEL:g})"
        )


class Verdict(NamedTuple):
    """The result of one of the tests: see `LackOfFit`."""

    p_value: float
    statistic: float
    degrees: tuple[int, int]
    where: str


def lack_of_fit(fit: MaterialFit) -> LackOfFit | None:
    """The tests of `fit`; None where there are too few pixels for any."""
    model = fit.objective.model(fit.theta)
    deviation = np.where(fit.objective.observations.used, fit.objective.observations.values - model, 0.0)
    scored, rms = _score(fit, model, deviation)
    verdicts = [*scored, *_runs(fit, deviation)]
    if not verdicts:
        return None
    worst = min(verdicts, key=lambda verdict: verdict.p_value)
    p_value = min(len(verdicts) * worst.p_value, 1.0)
    return LackOfFit(worst.statistic, worst.degrees, p_value, p_value < LEVEL, rms, worst.where)


def _score(fit: MaterialFit, model: Array, deviation: Array) -> tuple[list[Verdict], float]:
    """The score test, if there are enough pixels, and the relative size of what the extensions would add."""
    observations, objective = fit.objective.observations, fit.objective
    freedoms, names = _freedoms(fit)
    slope = np.where(observations.used, objective.loss.curvature(deviation / np.sqrt(objective.variance)), 0.0)
    slope = slope / objective.variance
    freedoms = objective.within(freedoms)
    j = objective.jacobian(fit.theta)[..., fit.free]  # a parameter at its limit says nothing about the model
    # an extension has no gradient along the parameters that were fitted: project them out
    inner = np.einsum("nc,ncp,ncq->pq", slope, j, j)
    freedoms = freedoms - j @ (np.linalg.pinv(inner, hermitian=True) @ np.einsum("nc,ncp,ncq->pq", slope, j, freedoms))
    scores = np.einsum("nc,nc,ncq->nq", fit.weight, deviation, freedoms)
    pixel = np.unique(observations.pixel, return_inverse=True)[1]
    scores = np.stack([np.bincount(pixel, column) for column in scores.T], axis=1)
    power = scores**2
    supported = power.sum(axis=0) ** 2 >= FEWEST * np.maximum((power**2).sum(axis=0), 1e-300)
    pixels = int(np.sum(power.any(axis=1)))
    if not supported.any() or pixels <= 3 * supported.sum():
        return [], fit.residuals.model_error
    scores, freedoms = scores[:, supported], freedoms[..., supported]
    total, spread = scores.sum(axis=0), scores.T @ scores
    scale = 1.0 / np.sqrt(np.diag(spread))
    quadratic = float(total * scale @ np.linalg.pinv(spread * np.outer(scale, scale), hermitian=True) @ (total * scale))
    # Hotelling's T² of scores whose mean is 0 under the model
    q, m = len(total), pixels - len(total)
    statistic = quadratic / q * m / max(pixels - quadratic, 1e-9 * pixels)
    curvature = np.einsum("nc,ncp,ncq->pq", fit.weight, freedoms, freedoms)
    missed = np.where(
        observations.used, freedoms @ (np.linalg.pinv(curvature, rcond=1e-9, hermitian=True) @ total), 0.0
    )
    rms = float(np.sqrt(np.sum(missed**2) / np.sum(np.where(observations.used, model, 0.0) ** 2)))
    where = [name for name, k in zip(names, supported, strict=True) if k][int(np.argmax(np.abs(total * scale)))]
    return [Verdict(float(f_distribution.sf(statistic, q, m)), statistic, (q, m), where)], rms


def _runs(fit: MaterialFit, deviation: Array) -> list[Verdict]:
    """Runs tests of the signs of the residuals, summed over channels, along φ, φ within the lobe, θ_i and θ_r."""
    observations = fit.objective.observations
    score = fit.weight * deviation * observations.sight.body
    _, first, pixel = np.unique(observations.pixel, return_index=True, return_inverse=True)
    of_pixel = np.asarray(np.bincount(pixel, score.sum(axis=1)), np.float64)
    of_pixel[np.abs(of_pixel) < 1e-9 * np.bincount(pixel, np.abs(score).sum(axis=1))] = 0.0  # its own body was fitted
    cosines, phi = observations.sight.cosines, observations.sight.least_half_angle
    glossy = fit.theta[STRENGTH] > 0.0
    lobe = phi < LOBE * np.exp(fit.theta[LOG_GAMMA]) if glossy else np.zeros(len(phi), bool)
    each = score.sum(axis=1)
    orders = (
        ("φ", phi, each),
        ("φ in the highlight", phi, np.where(lobe, each, 0.0)),
        ("θ_i", cosines.incidence.max(axis=1), each),
        ("θ_r", cosines.view[first, 0], of_pixel),  # all photographs of a pixel share θ_r, so residuals are correlated
    )
    return [verdict for order in orders if (verdict := _too_few_runs(*order)) is not None]


def _too_few_runs(name: str, key: Array, score: Array) -> Verdict | None:
    """The runs test of the signs of `score` in the order of `key`; None for fewer than FEWEST_SIGNS."""
    chosen = score != 0.0
    count = int(chosen.sum())
    if count < FEWEST_SIGNS:
        return None
    ordered = score[chosen][np.argsort(key[chosen], kind="stable")] > 0.0
    more = int(ordered.sum())
    middle = 2.0 * more * (count - more) / count
    spread = np.sqrt(max(middle * (middle - 1.0) / (count - 1.0), 1e-9))
    z = (middle - float(np.sum(ordered[1:] != ordered[:-1]))) / spread
    return Verdict(float(normal.sf(z)), z, (0, count), f"residuals of one sign follow each other along {name}")


def _freedoms(fit: MaterialFit) -> tuple[Array, list[str]]:
    """Derivatives (N, C, Q) of the values by each extension, and the remark that belongs to it."""
    sight, theta = fit.objective.observations.sight, fit.theta
    incidence, view = sight.cosines.incidence, sight.cosines.view
    tilts = np.stack([cosine**power for cosine in (incidence, view) for power in (1, 2)], axis=-1)
    shape = (*sight.body.shape, -1)
    c = channels_of(theta)
    columns, names = theta[:c, None] * _spread(sight, tilts).body.reshape(shape), [*BODY]
    if theta[STRENGTH] > 0.0 and fit.free[LOG_GAMMA]:
        u = (np.arccos(np.clip(sight.cosines.half, -1.0, 1.0)) / np.exp(theta[LOG_GAMMA])) ** 2  # (φ/γ)²
        shapes = np.stack([u**2 * np.exp(-2 * LN2 * u), u**2 * np.exp(-LN2 * u), (1 + u) ** -2, (1 + u) ** -1], axis=-1)
        facets = _spread(sight, shapes).interface(np.array([FLAT]), theta[LOG_N1:])[0][0].reshape(shape)
        strength = theta[STRENGTH] * interface_colour(theta)[:, None]
        of = "Student's of one ν" if theta[TAIL] > 0.0 else "Gaussian"
        names += [f"the facets are not {of}: their density has {what}" for what in FACETS]
        columns = np.concatenate([columns, strength * facets], axis=2)
    return columns, names


def _spread(sight: Sight, factors: Array) -> Sight:
    """`sight` with C·Q channels: the irradiance (N, L, C) times each of `factors` (N, L, Q)."""
    many = sight.irradiance[..., None] * factors[:, :, None, :]
    return replace(sight, irradiance=many.reshape(*many.shape[:2], -1))


def _p_text(p_value: float) -> str:
    return "< 1e-15" if p_value < 1e-15 else f"= {p_value:.2g}"
