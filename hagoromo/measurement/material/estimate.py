"""Estimate of a material from its fit: intervals, which parameters are identifiable, and remarks on the others.

A specular term is accepted only if χ² falls significantly (p < 1e-4) over all γ and n. If it is not, β, γ and n are
unknown; if it is, n may still be.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from hagoromo.errors import InputError
from hagoromo.measurement.gloss.faint_gloss import albedo, sweep_of_gloss, swept_interval
from hagoromo.measurement.material.albedo_variation import AlbedoVariation, find_albedo_variation
from hagoromo.measurement.material.interval import Profile, inflation, profile_over_n
from hagoromo.measurement.material.lack_of_fit import LackOfFit, lack_of_fit
from hagoromo.measurement.material.material_fit import fit_material
from hagoromo.measurement.material.quantity import alpha, body_colour, coordinate
from hagoromo.measurement.material.sandwich import MaterialFit, with_colour_error
from hagoromo.measurement.material.uncertainty import (
    correlation_of,
    errors_of,
    identifiable_of,
    intervals_of,
    is_identifiable,
    values_at,
)
from hagoromo.measurement.observations import Observations
from hagoromo.measurement.robust_fit import GAMMA_RANGE, N_RANGE, minimise
from hagoromo.measurement.sight import Array
from hagoromo.reflectance.material.material_estimate import MaterialEstimate

DETECTION = 21.1  # fall of χ² that noise reaches with probability 1e-4 for three parameters
PRIOR_N = 1.5  # refractive index of most dielectrics, plastic, skin and fibre among them: 1.3–1.7


def estimate_material(
    observations: Observations, name: str, pixels: int, n: float | None = None, white_error: Array | None = None
) -> MaterialEstimate:
    """α, β, γ, n and body colour of the material of `observations`.

    n: refractive index, if known. white_error: (C, C) covariance of ln white, if that was estimated.
    Raises `InputError` that names the material when there are too few values or the fit does not converge.
    """
    error = np.zeros((observations.channels, observations.channels)) if white_error is None else white_error
    try:
        fitted = _fitted(observations, error, n)
        if _detected(fitted.fit):
            return _glossy(observations, fitted, name, pixels, error)
        return _matte(_fitted(observations, error, n, with_interface=False), name, pixels, n)
    except InputError as wrong:
        raise InputError(f"{name}: {wrong}") from wrong


class Fitted(NamedTuple):
    """A fit with one body colour or one per pixel, and the test for its variation."""

    fit: MaterialFit
    albedo_variation: AlbedoVariation | None


def _fitted(observations: Observations, error: Array, n: float | None, with_interface: bool = True) -> Fitted:
    fit, albedo_variation = find_albedo_variation(fit_material(observations, n, with_interface))
    return Fitted(with_colour_error(fit, error), albedo_variation)


def _detected(fit: MaterialFit) -> bool:
    """Whether the interface term lowers χ² by more than DETECTION, in units of the robust estimate's variance."""
    c = len(fit.theta) - 3
    if fit.theta[c] <= 0.0:
        return False
    without = np.where(np.arange(c + 3) == c, 0.0, fit.theta)[None]
    matte = minimise(fit.objective, without, np.arange(c + 3) < c)
    if not matte.statuses.converged[0]:
        raise InputError(matte.statuses[0].remark("the matte material that a highlight is detected against"))
    fall = 2.0 * (matte.cost[0] - fit.objective.evaluate(fit.theta[None])[0][0])
    return bool(fall > DETECTION * inflation(fit, coordinate(c)))


def _glossy(observations: Observations, fitted: Fitted, name: str, pixels: int, error: Array) -> MaterialEstimate:
    """Estimate with the interface term: n is estimated, given, or not identifiable and then chosen."""
    fit = fitted.fit
    profile = profile_over_n(fit)
    intervals = intervals_of(profile)
    identifiable = identifiable_of(fit, intervals)
    tested = lack_of_fit(fit)
    remarks, values, covered = _remarks(fitted, tested, profile), values_at(fit.theta), fit
    if not fit.free[-1]:
        remarks.append(f"n = {values['n']:.4g} was given, not measured")
    elif not identifiable["n"]:
        chosen = float(np.clip(PRIOR_N, *intervals["n"]))
        values, covered = values_at(_fitted(observations, error, chosen).fit.theta), None
        remarks.append(f"n is not identifiable from these photographs: {chosen:.3g} was chosen, intervals allow any n")
    unknown = [key for key in ("alpha", "beta", "gamma") if not identifiable[key]]
    if unknown:
        remarks.append(f"not identifiable from these photographs: {', '.join(unknown)}")
    return MaterialEstimate(
        name,
        pixels,
        interface_colour=(1.0,) * observations.channels,
        standard_error=errors_of(covered, values, intervals),
        interval_95=intervals,
        correlation=correlation_of(fit),
        identifiable=identifiable,
        chi_square=fit.residuals.chi_square,
        remarks=tuple(remarks),
        lack_of_fit=None if tested is None else tested.record(),
        texture=None if fitted.albedo_variation is None else fitted.albedo_variation.record(),
        convergence=fit.status.record(),
        **values,
    )


def _matte(fitted: Fitted, name: str, pixels: int, n: float | None) -> MaterialEstimate:
    """Estimate where no interface reflection was detected: β, γ and n unknown, the specular albedo bounded above."""
    fit, c = fitted.fit, len(fitted.fit.theta) - 3
    sweep, values = sweep_of_gloss(fit, n), values_at(fit.theta)
    intervals: dict[str, Any] = {
        "alpha": swept_interval(sweep, alpha),
        "beta": (0.0, math.inf),
        "gamma": GAMMA_RANGE,
        "n": N_RANGE if n is None else (n, n),
        "specular_albedo": (0.0, min(swept_interval(sweep, albedo)[1], 1.0)),
        "body_colour": tuple(swept_interval(sweep, body_colour(channel)) for channel in range(c)),
    }
    alpha_identifiable = is_identifiable(values["alpha"], intervals["alpha"], (0.0, math.inf))
    tested = lack_of_fit(fit)
    return MaterialEstimate(
        name,
        pixels,
        interface_colour=(1.0,) * c,
        standard_error=errors_of(fit, values, intervals) | dict.fromkeys(("beta", "gamma", "n", "specular_albedo")),
        interval_95=intervals,
        correlation=correlation_of(fit),
        identifiable={"alpha": alpha_identifiable, "beta": False, "gamma": False, "n": False},
        chi_square=fit.residuals.chi_square,
        remarks=(
            *_remarks(fitted, tested),
            "no interface reflection was detected: beta, gamma and n are not identifiable from these photographs",
        ),
        lack_of_fit=None if tested is None else tested.record(),
        texture=None if fitted.albedo_variation is None else fitted.albedo_variation.record(),
        convergence=fit.status.record(),
        **values,
    )


def _remarks(fitted: Fitted, tested: LackOfFit | None, profile: Profile | None = None) -> list[str]:
    """Remarks on the residuals and on fits that did not converge."""
    residuals, remarks = fitted.fit.residuals, []
    if residuals.model_error:
        remarks.append(
            f"the model is incomplete: residuals are {residuals.scale:.3g} times the noise (χ² per degree of freedom "
            f"{residuals.chi_square:.3g}); a model error of {100 * residuals.model_error:.2g} % was added to the noise"
        )
    if residuals.outliers > 0.001:
        remarks.append(f"{100 * residuals.outliers:.2g} % of the values lie beyond 6 standard deviations")
    if tested is not None and tested.rejected:
        remarks.append(tested.remark())
    if fitted.albedo_variation is not None and (fitted.albedo_variation.per_pixel or fitted.albedo_variation.failure):
        remarks.append(fitted.albedo_variation.remark())
    if profile is not None and not profile.statuses.converged.all():
        unsettled = int(np.sum(~profile.statuses.converged))
        remarks.append(
            f"the fit did not converge at {unsettled} of the {len(profile.rest)} refractive indices that the intervals "
            "rest on: they may be too narrow"
        )
    return remarks
