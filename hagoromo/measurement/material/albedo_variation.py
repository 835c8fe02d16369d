"""Texture: whether the body colour of a material varies from pixel to pixel, by evidence, and the fit where it does.

Bodies of the pixels are drawn from a normal law around their mean, of relative width τ per channel. The evidence is the
gain of ln likelihood by the best τ over τ = 0, less ½ ln P for each: the criterion of Schwarz (1978). Bodies that
scatter by noise alone have none.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar

from hagoromo.errors import InputError
from hagoromo.least_squares import HUBER, NORMAL_MEDIAN, TUKEY
from hagoromo.measurement.material.material_fit import LACK, standstill, status_of
from hagoromo.measurement.material.sandwich import MaterialFit, with_covariance
from hagoromo.measurement.material.textured_objective import TexturedObjective
from hagoromo.measurement.robust_fit import minimise
from hagoromo.measurement.sight import Array

FEWEST_VALUES = 2  # of a pixel, on average, from which it can have a body of its own
FEWEST_PIXELS = 30
DECISIVE = 5.0  # ln of the odds from which on a texture is taken for one
TEXTURE_FIT_ROUNDS = 25
LOSS_ROUNDS = 5  # rounds after which the loss stays what it is
STANDSTILL = 0.02  # standard errors
TRIMMED = 0.02  # share of the pixels that may be anything: edges, dust
TRIMMED_VARIANCE = 0.8735  # of a normal law without the TRIMMED share that lies farthest
FARTHEST = 0.9  # leverage beyond which a value says nothing of the noise


@dataclass(frozen=True)
class Texture:
    """Variation of the body colour over the pixels of a material.

    variation: (C,) relative standard deviation τ. log_evidence: ln odds for it against one colour. per_pixel: whether
    the material was therefore measured pixel by pixel. failure: why it was not, although there is evidence; else "".
    """

    variation: tuple[float, ...]
    log_evidence: float
    per_pixel: bool
    failure: str = ""

    def record(self) -> dict[str, Any]:
        """As materials.json has it."""
        return {"per_pixel": self.per_pixel, "variation": list(self.variation), "log_evidence": self.log_evidence}

    def remark(self) -> str:
        """One line for people."""
        if self.failure:
            return f"the body colour varies from pixel to pixel, but one colour was fitted to all: {self.failure}"
        varies = ", ".join(f"{100.0 * share:.2g}" for share in self.variation)
        return (
            f"the body colour varies from pixel to pixel (by {varies} % per channel, ln odds {self.log_evidence:.3g}): "
            "it was measured pixel by pixel, alpha and body_colour are the means of those that were fitted"
        )


def find_texture(fit: MaterialFit) -> tuple[MaterialFit, Texture | None]:
    """The fit with each pixel's own body where there is evidence for it, else `fit`; None where nothing can tell."""
    seen = fit.objective.seen
    pixels = len(np.unique(seen.pixel))
    if pixels < FEWEST_PIXELS or np.sum(seen.used) < FEWEST_VALUES * pixels * seen.channels * np.mean(_seen(fit)):
        return fit, None
    first = _evidence(_objective(fit, fit.theta, np.ones_like(seen.values)), fit.theta)
    if not first.per_pixel:
        return fit, first
    try:
        textured = fit_textured(fit)
    except InputError as error:
        return fit, replace(first, per_pixel=False, failure=str(error))
    objective = textured.objective
    assert isinstance(objective, TexturedObjective)
    last = _evidence(objective, textured.theta)
    return (textured, last) if last.per_pixel else (fit, last)


def fit_textured(fit: MaterialFit) -> MaterialFit:
    """`fit` anew with each pixel's own body; `InputError` when the rounds do not come to a standstill."""
    seen, theta, free = fit.objective.seen, fit.theta.copy(), fit.free
    objective, change = _objective(fit, theta, np.ones_like(seen.values)), np.inf
    biweight, scale = True, 1.0
    for turn in range(TEXTURE_FIT_ROUNDS):
        model = objective.model(theta)
        variance = seen.variance_at(model)
        if turn < LOSS_ROUNDS:
            scale = _scale(objective, (seen.values - model) / np.sqrt(variance))
            biweight = scale <= LACK
        loss = TUKEY if biweight else HUBER
        spread = variance * max(scale, 1.0) ** 2
        weights = loss.weight((seen.values - model) / np.sqrt(spread))
        objective = TexturedObjective(seen, spread, loss, weights)
        theta[:-3] = np.nanmean(objective.bodies(theta), axis=0)
        rows = minimise(objective, theta[None], free)
        moved = (rows.theta[0] - theta)[free]
        theta = rows.theta[0]
        change = float(moved @ rows.curvature[0][np.ix_(free, free)] @ moved) ** 0.5
        if turn >= LOSS_ROUNDS and standstill(rows, change, STANDSTILL):
            return with_covariance(objective, theta, free, scale, 0.0, status_of(rows, turn + 1, change))
    raise InputError(
        f"the fit of each pixel's body still moves by {change:.2g} standard errors after {TEXTURE_FIT_ROUNDS} rounds"
    )


def _objective(fit: MaterialFit, theta: Array, weights: Array) -> TexturedObjective:
    seen = fit.objective.seen
    return TexturedObjective(seen, seen.variance_at(fit.objective.model(theta)), fit.objective.loss, weights)


def _seen(fit: MaterialFit) -> Array:
    """(C,) share of the pixels that each channel was seen in: mosaics leave gaps."""
    seen = fit.objective.seen
    count = len(np.unique(seen.pixel))
    return np.array([len(np.unique(seen.pixel[used])) / count for used in seen.used.T])


def _scale(objective: TexturedObjective, r: Array) -> float:
    """Robust standard deviation of residuals r (N, C), what each pixel's body took up of them given back."""
    left = 1.0 - objective.own_leverage()
    known = objective.seen.used & (left > 1.0 - FARTHEST)
    return float(np.sqrt(np.median((r**2 / np.maximum(left, 0.01))[known]) / NORMAL_MEDIAN)) if known.any() else 1.0


def _evidence(objective: TexturedObjective, theta: Array) -> Texture:
    """Texture by the scatter of the bodies (P, C) at the interface of θ, over their own errors."""
    seen, bodies = objective.seen, objective.bodies(theta)
    deviation = (seen.values - objective.model(theta)) / np.sqrt(objective.variance)
    noise = _scale(objective, deviation) ** 2
    widths, gain = [], 0.0
    for body, power in zip(bodies.T, objective.power.T, strict=True):
        known = power > 0.0
        middle = float(np.median(body[known]))
        width, ratio = _width(body[known] - middle, noise / power[known])
        widths.append(width / max(abs(middle), 1e-12))
        gain += ratio - 0.5 * np.log(np.sum(known))
    return Texture(tuple(widths), float(gain), bool(gain > DECISIVE))


def _width(off: Array, variance: Array) -> tuple[float, float]:
    """Standard deviation beyond `variance` (P,) that explains `off` (P,) best, and its gain of ln likelihood.

    The TRIMMED share that lies farthest is left out.
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
