"""Albedo variation: whether the body colour of a material varies from pixel to pixel, and the fit if it does.

Model: body colours of the pixels are normally distributed about their mean, with a relative width τ per channel. The
evidence is the gain of ln likelihood of the best τ over τ = 0, less ½ ln P for each τ: the criterion of Schwarz (1978).
Body colours that scatter by noise alone give no evidence.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar

from hagoromo.errors import InputError
from hagoromo.least_squares.loss import HUBER, NORMAL_MEDIAN, TUKEY
from hagoromo.measurement.material.material_fit import INCOMPLETE_SCALE, at_standstill, status_of
from hagoromo.measurement.material.material_objective import AlbedoVariationObjective
from hagoromo.measurement.material.sandwich import MaterialFit, with_covariance
from hagoromo.measurement.robust_fit import minimise
from hagoromo.measurement.sight import Array

FEWEST_VALUES = 2  # values per pixel, on average, from which a pixel can have its own body colour
FEWEST_PIXELS = 30
DECISIVE_LOG_ODDS = 5.0  # ln of the odds above which the albedo is taken to vary
ALBEDO_FIT_ROUNDS = 25
LOSS_ROUNDS = 5  # rounds after which the choice of the loss is final
ALBEDO_FIT_STANDSTILL = 0.02  # standard errors
TRIMMED = 0.02  # share of the pixels that may be outliers: edges, dust
TRIMMED_VARIANCE = 0.8735  # variance of a standard normal distribution without the most extreme TRIMMED share
LARGEST_LEVERAGE = 0.9  # values of larger leverage carry no information on the noise


@dataclass(frozen=True)
class AlbedoVariation:
    """Variation of the body colour over the pixels of a material.

    variation: (C,) relative standard deviation τ. log_evidence: ln odds for variation against one colour. per_pixel:
    whether body colours were therefore estimated per pixel. failure: why not, although there is evidence; else "".
    """

    variation: tuple[float, ...]
    log_evidence: float
    per_pixel: bool
    failure: str = ""

    def record(self) -> dict[str, Any]:
        """The entry in materials.json."""
        return {"per_pixel": self.per_pixel, "variation": list(self.variation), "log_evidence": self.log_evidence}

    def remark(self) -> str:
        """One line for a report."""
        if self.failure:
            return f"the body colour varies from pixel to pixel, but one colour was fitted to all: {self.failure}"
        varies = ", ".join(f"{100.0 * share:.2g}" for share in self.variation)
        return (
            f"the body colour varies from pixel to pixel (by {varies} % per channel, ln odds {self.log_evidence:.3g}): "
            "it was estimated per pixel; alpha and body_colour are the means over the fitted pixels"
        )


def find_albedo_variation(fit: MaterialFit) -> tuple[MaterialFit, AlbedoVariation | None]:
    """The fit with a body colour per pixel where there is evidence for it, else `fit`; None if it cannot be tested."""
    observations = fit.objective.observations
    pixels = len(np.unique(observations.pixel))
    if pixels < FEWEST_PIXELS or np.sum(observations.used) < FEWEST_VALUES * pixels * observations.channels * np.mean(
        _channel_coverage(fit)
    ):
        return fit, None
    first = _evidence(_objective(fit, fit.theta, np.ones_like(observations.values)), fit.theta)
    if not first.per_pixel:
        return fit, first
    try:
        varying = fit_albedo_variation(fit)
    except InputError as error:
        return fit, replace(first, per_pixel=False, failure=str(error))
    objective = varying.objective
    assert isinstance(objective, AlbedoVariationObjective)
    last = _evidence(objective, varying.theta)
    return (varying, last) if last.per_pixel else (fit, last)


def fit_albedo_variation(fit: MaterialFit) -> MaterialFit:
    """`fit` repeated with a body colour per pixel; `InputError` when the rounds do not converge."""
    observations, theta, free = fit.objective.observations, fit.theta.copy(), fit.free
    objective, change = _objective(fit, theta, np.ones_like(observations.values)), np.inf
    biweight, scale = True, 1.0
    for turn in range(ALBEDO_FIT_ROUNDS):
        model = objective.model(theta)
        variance = observations.variance_at(model)
        if turn < LOSS_ROUNDS:
            scale = _scale(objective, (observations.values - model) / np.sqrt(variance))
            biweight = scale <= INCOMPLETE_SCALE
        loss = TUKEY if biweight else HUBER
        spread = variance * max(scale, 1.0) ** 2
        weights = loss.weight((observations.values - model) / np.sqrt(spread))
        objective = AlbedoVariationObjective(observations, spread, loss, weights, fit.objective.shaped)
        theta[: observations.channels] = np.nanmean(objective.bodies(theta), axis=0)
        rows = minimise(objective, theta[None], free)
        moved = (rows.theta[0] - theta)[free]
        theta = rows.theta[0]
        change = float(moved @ rows.curvature[0][np.ix_(free, free)] @ moved) ** 0.5
        if turn >= LOSS_ROUNDS and at_standstill(rows, change, ALBEDO_FIT_STANDSTILL):
            return with_covariance(objective, theta, free, scale, 0.0, status_of(rows, turn + 1, change))
    raise InputError(
        f"the fit of each pixel's body still moves by {change:.2g} standard errors after {ALBEDO_FIT_ROUNDS} rounds"
    )


def _objective(fit: MaterialFit, theta: Array, weights: Array) -> AlbedoVariationObjective:
    observations = fit.objective.observations
    return AlbedoVariationObjective(
        observations,
        observations.variance_at(fit.objective.model(theta)),
        fit.objective.loss,
        weights,
        fit.objective.shaped,
    )


def _channel_coverage(fit: MaterialFit) -> Array:
    """(C,) share of the pixels in which each channel was measured: mosaics leave gaps."""
    observations = fit.objective.observations
    count = len(np.unique(observations.pixel))
    return np.array([len(np.unique(observations.pixel[used])) / count for used in observations.used.T])


def _scale(objective: AlbedoVariationObjective, r: Array) -> float:
    """Robust standard deviation of residuals r (N, C), corrected for the leverage of each pixel's own body colour."""
    left = 1.0 - objective.own_leverage()
    known = objective.observations.used & (left > 1.0 - LARGEST_LEVERAGE)
    return float(np.sqrt(np.median((r**2 / np.maximum(left, 0.01))[known]) / NORMAL_MEDIAN)) if known.any() else 1.0


def _evidence(objective: AlbedoVariationObjective, theta: Array) -> AlbedoVariation:
    """Variation of the body colours (P, C) for the interface of θ, in excess of their own errors."""
    observations, bodies = objective.observations, objective.bodies(theta)
    deviation = (observations.values - objective.model(theta)) / np.sqrt(objective.variance)
    noise = _scale(objective, deviation) ** 2
    widths, gain = [], 0.0
    for body, power in zip(bodies.T, objective.power.T, strict=True):
        known = power > 0.0
        middle = float(np.median(body[known]))
        width, ratio = _width(body[known] - middle, noise / power[known])
        widths.append(width / max(abs(middle), 1e-12))
        gain += ratio - 0.5 * np.log(np.sum(known))
    return AlbedoVariation(tuple(widths), float(gain), bool(gain > DECISIVE_LOG_ODDS))


def _width(off: Array, variance: Array) -> tuple[float, float]:
    """Standard deviation in excess of `variance` (P,) that best explains `off` (P,), and its gain of ln likelihood.

    The TRIMMED share with the largest deviations is excluded.
    """
    near = np.argsort(off**2 / variance)[: max(int(len(off) * (1.0 - TRIMMED)), 1)]
    off, variance = off[near] / TRIMMED_VARIANCE**0.5, variance[near]

    def loss(log_width: float) -> float:
        ratio = np.exp(2.0 * log_width) / variance
        return float(0.5 * np.sum(np.log1p(ratio) - off**2 / variance * ratio / (1.0 + ratio)))

    typical = 0.5 * np.log(np.median(variance))
    top = max(typical, 0.5 * np.log(max(float(np.mean(off**2)), 1e-300))) + 2.0
    best = minimize_scalar(loss, bounds=(typical - 6.0, top), method="bounded")
    return (float(np.exp(best.x)), -float(best.fun)) if best.fun < 0.0 else (0.0, 0.0)
