"""Gloss estimate: the Measurement of a photometric fit; body colour varies from pixel to pixel, gloss is shared."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.least_squares.fit_status import Status
from hagoromo.least_squares.loss import NORMAL_95, log_interval
from hagoromo.measurement.facets import TAIL_RANGE
from hagoromo.measurement.gloss.gloss_map import GlossMap, with_tails
from hagoromo.measurement.material.misfit_shift import evidence_of_misfit
from hagoromo.measurement.material.model_choice import Model, model_remarks
from hagoromo.measurement.material.quantity import Quantity, colour_of_interface, coordinate, log_albedo, log_beta
from hagoromo.measurement.material.uncertainty import is_identifiable, remarks_on_unknown, values_at
from hagoromo.measurement.measurement import Measurement
from hagoromo.measurement.normals.highlight_check import highlight_check, highlight_shift
from hagoromo.measurement.normals.lobe_estimate import FurtherLobes, width_interval
from hagoromo.measurement.normals.normals import NormalMap
from hagoromo.measurement.normals.photometric_model import Fit, predicted
from hagoromo.measurement.normals.pixel_fit import STILL_MOVING_SHARE
from hagoromo.measurement.normals.shading import EXPONENT, SIGMA, TAIL, N
from hagoromo.measurement.normals.views import Array
from hagoromo.measurement.parameters import (
    LOG_GAMMA,
    N_RANGE,
    STRENGTH,
    channels_of,
    colour_slice,
    pack_theta,
)
from hagoromo.measurement.parameters import TAIL as TAIL_OF_THETA
from hagoromo.photograph.capture import Capture
from hagoromo.reflectance.material.material_estimate import MaterialEstimate
from hagoromo.reflectance.parameters import ROWS

RELATIVE_LIMIT = 0.25  # largest relative standard error of an identifiable parameter
PARTS = 4.0 * math.pi  # independent parts of an object, each half its radius wide
LARGEST_LAW_ERROR = 0.1  # standard error of ε or σ at which it is identifiable: half of its prior
WIDENED = "errors and intervals of beta and gamma are wider by how far the highlight is from the model"
NOTABLE = 2.0  # standard errors by which σ must differ from 0 to be remarked upon


def measurement_of(capture: Capture, normal_map: NormalMap) -> Measurement:
    """The Measurement of `capture` from its normals.

    alpha and body_colour of a material are medians over its pixels. n is not identifiable with lamps and eye on one
    side; it is set to 1.5. `InputError` when `normal_map` is of another capture.
    """
    fit, views = normal_map.fit, normal_map.views
    if len(capture.photographs) != len(views.values):
        raise InputError("the normals are of another capture: solve them for this one")
    model = fit.evenness(views.place)[:, None] * predicted(fit, views.to_lamp, views.to_eye)
    masks = views.valid(capture.photographs)
    residual = np.where(masks[:, None], (views.values - model) / np.sqrt(views.variance), np.nan)
    predictions, residuals = (
        tuple(views.image(one.T.astype(np.float32), np.nan) for one in values)
        for values in (model * views.light, residual)
    )
    materials = tuple(_material(normal_map, residual, number) for number in range(len(fit.gloss.rows)))
    labels = np.full(views.shape, -1)
    labels[views.rows, views.columns] = fit.labels
    return Measurement(materials, labels, predictions, residuals, normal_map.normals)


def solved_gloss_map(
    normal_map: NormalMap, materials: Sequence[MaterialEstimate], labels: NDArray[np.integer]
) -> GlossMap | None:
    """Maps of β, γ and ν, with their standard errors, where the gloss of a material varies; None if none does."""
    fit, views = normal_map.fit, normal_map.views
    if fit.own is None:
        return None
    tail, of_tail = fit.own.value[:, 2], np.sqrt(fit.own.covariance[:, 2, 2])
    value = np.exp(fit.own.value[:, :2])
    value[:, 0] *= fit.gloss.colour.mean(axis=1)[fit.labels]  # β of an interface colour of mean 1
    least = np.array([_least_errors(material) for material in materials])[fit.labels]
    error = value * np.maximum(np.sqrt(np.einsum("pii->pi", fit.own.covariance[:, :2, :2])), least)
    beta, gamma, beta_error, gamma_error = (views.image(one, np.nan) for one in (*value.T, *error.T))
    body = np.where(labels[..., None] >= 0, normal_map.body, np.nan).astype(np.float64)
    unknown = np.full(body.shape, np.nan)
    maps = GlossMap(beta, gamma, beta_error, gamma_error, body, unknown)
    if not any(test is not None and test.varies and test.spread[2] > 0.0 for test in fit.own_tests):
        return with_tails(maps, materials, labels)
    with np.errstate(divide="ignore", invalid="ignore"):
        nu, nu_error = (views.image(one, np.nan) for one in (1.0 / tail, of_tail / tail**2))
    return replace(maps, nu=nu, nu_error=nu_error)


def _least_errors(material: MaterialEstimate) -> tuple[float, float]:
    """Relative errors of β and γ below which no pixel of `material` comes: its own, where the model does not fit it."""
    if material.lack_of_fit is None or not material.beta > 0.0:
        return 0.0, 0.0
    wrong = math.sqrt(evidence_of_misfit(material.lack_of_fit["p_value"]))
    beta, gamma = (wrong * material.standard_error[key] / getattr(material, key) for key in ("beta", "gamma"))
    return beta, gamma


def _material(normal_map: NormalMap, residual: Array, number: int) -> MaterialEstimate:
    """The estimate of one material; residual: (K, C, P) in standard deviations of the noise."""
    fit = normal_map.fit
    mine = fit.labels == number
    known = np.isfinite(residual).all(axis=1) & normal_map.views.used
    misfit, shift = highlight_check(fit, normal_map.views, known, number), np.zeros(2)
    if misfit is not None:
        shift = highlight_shift(fit, normal_map.views, known, number)
        shift = math.sqrt(evidence_of_misfit(misfit.p_value)) * shift
        fit = _widened(fit, number, shift)
    body = np.median(fit.body[:, mine], axis=1)
    alpha, parts = float(body.mean()), max(PARTS * float(mine.mean()), 1.0)
    varies = float(np.std(fit.body[:, mine].mean(axis=0))) / alpha
    scatter = np.std(fit.body[:, mine] / fit.body[:, mine].mean(axis=0), axis=1) / math.sqrt(parts)
    colour = body / alpha
    gloss = _Gloss(fit, number, body)
    value: dict[str, Any] = gloss.values() | {"alpha": alpha}
    relative = gloss.relative_errors() | {"alpha": math.hypot(varies / math.sqrt(parts), fit.model_error)}
    error: dict[str, Any] = {key: value[key] * relative[key] for key in relative}
    interval: dict[str, Any] = {key: log_interval(value[key], relative[key]) for key in relative}
    interval["gamma"] = width_interval(value["gamma"], relative["gamma"])
    of_colour = tuple(
        (c - NORMAL_95 * s, c + NORMAL_95 * s) for c, s in zip(colour.tolist(), scatter.tolist(), strict=True)
    )
    interval |= {"n": N_RANGE, "body_colour": of_colour} | gloss.intervals()
    identifiable = {key: relative[key] <= RELATIVE_LIMIT for key in ("alpha", "beta", "gamma")} | {"n": False}
    identifiable |= gloss.identifiable(interval["nu"])
    law = _body_law(fit, number)
    value |= {key: one for key, (one, _) in law.items()}
    error |= {key: spread for key, (_, spread) in law.items()}
    interval |= {key: (one - NORMAL_95 * spread, one + NORMAL_95 * spread) for key, (one, spread) in law.items()}
    identifiable |= {key: spread <= LARGEST_LAW_ERROR for key, (_, spread) in law.items()}
    both = gloss.correlation()
    further = FurtherLobes.of(fit, number, shift)
    if further.lobes:
        value |= {"lobes": further.lobes, "specular_albedo": value["specular_albedo"] + further.albedo}
    error |= {"lobes": further.errors()}
    interval |= {"lobes": further.intervals()}
    own = fit.own_tests[number] if fit.own_tests else None
    return MaterialEstimate(
        name=f"material {number + 1}",
        pixels=int(mine.sum()),
        body_colour=tuple(colour.tolist()),
        n=N,
        standard_error=error | {"n": None, "body_colour": tuple(scatter.tolist())} | gloss.errors(),
        interval_95=interval,
        correlation=((1.0, None, None, None), (None, 1.0, both, None), (None, both, 1.0, None), (None,) * 4),
        identifiable=identifiable,
        lack_of_fit=None if misfit is None else misfit.record(),
        chi_square=float(np.nanmean(residual[:, :, mine] ** 2)),
        remarks=(
            f"body colours are estimated per pixel: they vary by {100 * varies:.0f} % over the material",
            *further.remarks(),
            *([] if own is None else own.remarks()),
            *([misfit.remark(), WIDENED] if misfit is not None and misfit.rejected else []),
            *_remarks(fit, number, identifiable, interval["nu"][0]),
        ),
        gloss=None if own is None else own.record(),
        convergence=None if fit.status is None else fit.status.record(),
        **value,
    )


def _widened(fit: Fit, number: int, shift: Array) -> Fit:
    """`fit` with errors (2,) of ln β and ln γ of one material that its model makes, in addition to those of noise."""
    covariance = fit.covariance.copy()
    covariance[number, :2, :2] += np.outer(shift, shift)
    return replace(fit, covariance=covariance)


def _body_law(fit: Fit, number: int) -> dict[str, tuple[float, float]]:
    """Exponent ε and roughness σ of the body of one material, each with its standard error."""
    sigma, log_exponent = fit.gloss.rows[number, SIGMA : EXPONENT + 1].tolist()
    errors = np.sqrt(np.diag(fit.covariance[number])[SIGMA : EXPONENT + 1]).tolist()
    exponent = math.exp(log_exponent)
    return {"epsilon": (exponent - 1.0, exponent * errors[1]), "sigma": (sigma, errors[0])}


class _Gloss:
    """The gloss of one material as the parameters θ of `parameters`, with their covariance; n and body are fixed."""

    def __init__(self, fit: Fit, number: int, body: Array) -> None:
        rows, channels = fit.gloss.rows[number], len(body)
        self.free = np.zeros(len(rows), bool) if fit.choice is None else fit.choice.free[number]
        self.wide = None if fit.choice is None else (fit.choice.wide[number], fit.choice.wide_covariance[number])
        colour = fit.gloss.colour[number]
        beta, gamma = np.exp(rows[:2])
        nu = 1.0 / rows[TAIL] if rows[TAIL] > 0.0 else math.inf
        mean = float(colour.mean())
        self.theta = pack_theta(body, float(beta) * mean, float(gamma), N, nu, colour / mean)
        slopes = np.zeros((len(self.theta), len(rows)))
        slopes[STRENGTH, 0], slopes[LOG_GAMMA, 1] = self.theta[STRENGTH], 1.0
        if self.free[TAIL]:
            slopes[TAIL_OF_THETA, TAIL] = 1.0
        if self.coloured:
            slopes[colour_slice(channels), TAIL + 1 :] = np.eye(channels - 1)
        self.covariance = slopes @ fit.covariance[number] @ slopes.T

    @property
    def coloured(self) -> bool:
        """Whether the interface has a colour of its own."""
        return bool(self.free[TAIL + 1 :].any())

    def error(self, quantity: Quantity) -> float:
        """Standard error of `quantity`."""
        gradient = quantity(self.theta[None])[1][0]
        return math.sqrt(float(gradient @ self.covariance @ gradient))

    def values(self) -> dict[str, Any]:
        """Of the gloss, by their names in `MaterialEstimate`."""
        of_body = ("alpha", "body_colour", "n")  # medians over pixels, and chosen
        values = {key: value for key, value in values_at(self.theta).items() if key not in of_body}
        return values | {"specular_albedo": math.exp(float(log_albedo(self.theta[None])[0][0]))}

    def relative_errors(self) -> dict[str, float]:
        """Standard errors of ln β, ln γ and ln of the specular albedo."""
        quantities = {"beta": log_beta, "gamma": coordinate(LOG_GAMMA), "specular_albedo": log_albedo}
        return {key: self.error(quantity) for key, quantity in quantities.items()}

    def correlation(self) -> float:
        """Of ln β and ln γ."""
        gradient, spread = log_beta(self.theta[None])[1][0], self.relative_errors()
        return float(gradient @ self.covariance[:, LOG_GAMMA]) / (spread["beta"] * spread["gamma"])

    def errors(self) -> dict[str, Any]:
        """Standard errors of ν and of the interface colour, None where they were not estimated."""
        tail, channels = float(self.theta[TAIL_OF_THETA]), channels_of(self.theta)
        known = bool(self.free[TAIL]) and tail > 0.0
        colours = tuple(self.error(colour_of_interface(i)) for i in range(channels)) if self.coloured else None
        return {"nu": self.error(coordinate(TAIL_OF_THETA)) / tail**2 if known else None, "interface_colour": colours}

    def intervals(self) -> dict[str, Any]:
        """95 % intervals of ν and the interface colour; where facets stay Gaussian, ν is bounded by the wider fit."""
        low, high = TAIL_RANGE
        if self.free[TAIL]:
            reach = NORMAL_95 * self.error(coordinate(TAIL_OF_THETA))
            tail = float(self.theta[TAIL_OF_THETA])
            low, high = max(tail - reach, low), min(tail + reach, high)
        elif self.wide is not None and self.wide[0][TAIL] > 0.0:
            rows, covariance = self.wide
            high = min(float(rows[TAIL]) + NORMAL_95 * math.sqrt(float(covariance[TAIL, TAIL])), high)
        found: dict[str, Any] = {"nu": (1.0 / high, math.inf if low <= 0.0 else 1.0 / low)}
        if self.coloured:
            colour, errors = self.values()["interface_colour"], self.errors()["interface_colour"]
            pairs = zip(colour, errors, strict=True)
            found["interface_colour"] = tuple((c - NORMAL_95 * e, c + NORMAL_95 * e) for c, e in pairs)
        return found

    def identifiable(self, of_nu: tuple[float, float]) -> dict[str, bool]:
        """Whether ν and the interface colour are known well enough."""
        nu, errors = self.values()["nu"], self.errors()["interface_colour"]
        return {
            "nu": math.isfinite(nu) and is_identifiable(nu, of_nu, ROWS["nu"].fit.range),
            "interface_colour": errors is not None and max(errors) <= RELATIVE_LIMIT,
        }


def _remarks(fit: Fit, number: int, identifiable: dict[str, bool], least_nu: float) -> list[str]:
    """Remarks on fits that did not converge, on the error of the model, and on parameters that are not identifiable."""
    remarks = [
        *_unsettled(fit, number),
        f"the error of the model is {100 * fit.model_error:.1f} %, in addition to the noise",
        f"n is not identifiable with all lamps on the camera's side: {N} was chosen, and beta holds for it",
        *([] if fit.smooth is None else [fit.smooth.stiffness.remark()]),
    ]
    if fit.choice is not None:
        free, rises = fit.choice.free[number], (fit.choice.tails[number], fit.choice.coloured[number])
        tails, coloured = (None if np.isnan(rise) else float(rise) for rise in rises)
        model = Model(bool(free[TAIL]), bool(free[TAIL + 1 :].any()))
        remarks += model_remarks(tails, coloured, model, least_nu, fit.choice.failure)
    sigma, error = float(fit.gloss.rows[number, 2]), math.sqrt(fit.covariance[number, 2, 2])
    if abs(sigma) > NOTABLE * error:
        way = "more" if sigma > 0.0 else "less"
        remarks.append(f"its body sends {way} light back than Lambert's law: roughness {sigma:.2f} ± {error:.2f}")
    return remarks + remarks_on_unknown(identifiable)


def _unsettled(fit: Fit, number: int) -> list[str]:
    """One line for the fit of gloss and lamps, and one for the normals, where they did not converge."""
    remarks = []
    if fit.status is not None and not fit.status.converged:
        remarks.append(fit.status.remark("gloss and lamps"))
    if fit.shape_status is not None and not fit.shape_status.converged:
        remarks.append(fit.shape_status.remark("the surface under near lamps"))
    if fit.pixel_status is not None:
        share = float(np.mean(fit.pixel_status[fit.labels == number] != Status.CONVERGED))
        if share > STILL_MOVING_SHARE:
            remarks.append(f"the normal of {100.0 * share:.2g} % of its pixels did not converge")
    return remarks
