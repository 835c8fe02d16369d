"""Estimate of a material from its fit: intervals, which parameters are identifiable, and remarks on the others.

A specular term is accepted only if χ² falls significantly (p < 1e-4) over all γ and n. If it is not, β, γ and n are
unknown; if it is, n may still be.

Hidden body: intervals of a material whose body is black, or lies wholly under a highlight that no photograph leaves.

No body reflects less than nothing. Where the best fit has none in some channel, it is at the limit of its range, and
how bright it may be does not follow from the curvature there. It follows from a profile along the strength of the
highlight: the less of it, the more of the body. So it does where the strength is known too badly for its errors to be
normal: a faint narrow lobe on a body and a strong wide one on nothing may explain the photographs alike.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.stats import chi2
from scipy.stats import t as student

from hagoromo.errors import InputError
from hagoromo.measurement.gloss.faint_gloss import albedo, sweep_of_gloss, swept_interval
from hagoromo.measurement.material.albedo_variation import find_albedo_variation
from hagoromo.measurement.material.interval import (
    NODES,
    WELL_KNOWN,
    Profile,
    degrees_of_freedom,
    inflation,
    largest_tail,
    profile_from,
    profile_over_n,
    profile_over_tail,
)
from hagoromo.measurement.material.lack_of_fit import LackOfFit, lack_of_fit
from hagoromo.measurement.material.material_fit import fit_material
from hagoromo.measurement.material.misfit_shift import with_misfit
from hagoromo.measurement.material.model_choice import (
    ChosenFit,
    Facets,
    Fitted,
    Interface,
    choose_fit,
    fit_as,
    model_remarks,
)
from hagoromo.measurement.material.quantity import Quantity, alpha, body_colour, colour_of_interface, coordinate
from hagoromo.measurement.material.sandwich import MaterialFit, inverse_over, with_colour_error
from hagoromo.measurement.material.uncertainty import (
    correlation_of,
    errors_of,
    identifiable_of,
    intervals_of,
    intervals_of_hidden,
    is_identifiable,
    remarks_on_unknown,
    values_at,
    with_open_strength,
)
from hagoromo.measurement.observations import Observations
from hagoromo.measurement.parameters import LOG_N1, STRENGTH, TAIL, channels_of, colour_slice
from hagoromo.measurement.robust_fit import minimise
from hagoromo.measurement.sight import Array
from hagoromo.reflectance.material.material_estimate import MaterialEstimate
from hagoromo.reflectance.parameters import GLOSS, OPEN_GLOSS

WIDENED = "errors and intervals are wider by how far the highlight and the body are from the model"
HIDDEN = (
    "its body reflects nothing in a channel at least, or the highlight hides it: intervals are those of all bodies "
    "that the photographs allow; one whose lamp is farther from where its mirror image is seen says more"
)
DETECTION = 1e-4  # probability that noise lowers χ² as much as an interface term has to
PRIOR_N = 1.5  # refractive index of most dielectrics, plastic, skin and fibre among them: 1.3–1.7
STEPS = np.linspace(0.02, 1.5, 38)  # of the strength, over the estimate
OPEN_STEPS = np.geomspace(0.02, 1000.0, 49)  # the same, where it may be of any size


def estimate_material(
    observations: Observations,
    name: str,
    pixels: int,
    n: float | None = None,
    white_error: Array | None = None,
    facets: Facets = "auto",
    interface: Interface = "auto",
) -> MaterialEstimate:
    """α, β, γ, n and body colour of the material of `observations`; ν and interface colour where there is evidence.

    n: refractive index, if known. white_error: (C, C) covariance of ln white, if that was estimated. facets,
    interface: whether tails and a colour of the interface are estimated: by evidence, never, or always (`choose_fit`).
    Raises `InputError` that names the material when there are too few values or the fit does not converge.
    """
    error = np.zeros((observations.channels, observations.channels)) if white_error is None else white_error
    try:
        chosen = choose_fit(observations, n, facets, interface)
        if _detected(chosen.fitted.fit):
            return _glossy(observations, chosen, name, pixels, error)
        matte = Fitted(*find_albedo_variation(fit_material(observations, n, with_interface=False)))
        tested = lack_of_fit(matte.fit)
        return _matte(_with_error(matte, error, tested), tested, name, pixels, n)
    except InputError as wrong:
        raise InputError(f"{name}: {wrong}") from wrong


def _with_error(fitted: Fitted, error: Array, tested: LackOfFit | None) -> Fitted:
    """`fitted` with the errors of the lamps' colour and of the model in its covariance."""
    return fitted._replace(fit=with_misfit(with_colour_error(fitted.fit, error), tested))


def _detected(fit: MaterialFit) -> bool:
    """Whether the interface term lowers χ² by more than DETECTION, in units of the robust estimate's variance."""
    places, channels = np.arange(fit.theta.size), channels_of(fit.theta)
    if fit.theta[STRENGTH] <= 0.0:
        return False
    without = np.where(places == places[STRENGTH], 0.0, fit.theta)[None]
    matte = minimise(fit.objective, without, places < channels)
    if not matte.statuses.converged[0]:
        raise InputError(matte.statuses[0].remark("the matte material that a highlight is detected against"))
    fall = 2.0 * (matte.cost[0] - fit.objective.evaluate(fit.theta[None])[0][0])
    limit = chi2.isf(DETECTION, max(int(fit.free[channels:].sum()), 3))
    return bool(fall > limit * inflation(fit, coordinate(STRENGTH)))


def _glossy(observations: Observations, chosen: ChosenFit, name: str, pixels: int, error: Array) -> MaterialEstimate:
    """Estimate with the interface term: n is estimated, given, or not identifiable and then chosen."""
    tested = lack_of_fit(chosen.fitted.fit)
    fitted, wide = (_with_error(one, error, tested) for one in (chosen.fitted, chosen.wide))
    chosen = replace(chosen, fitted=fitted, wide=wide)
    fit = fitted.fit
    profile = profile_over_n(fit)
    over_tails = None
    if chosen.tails is not None and not chosen.model.tails:
        over_tails = profile_over_tail(wide.fit)
    intervals = _with_wide(chosen, intervals_of(profile, over_tails))
    if is_hidden(fit):
        intervals |= intervals_of_hidden(profile_over_strength(fit))
    elif is_open(fit):
        intervals = with_open_strength(intervals, profile_over_strength(fit))
    identifiable = identifiable_of(fit, intervals)
    remarks, values = _remarks(fitted, tested, profile), values_at(fit.theta)
    covered = None if is_hidden(fit) else fit
    if not fit.free[-1]:
        remarks.append(f"n = {values['n']:.4g} was given, not measured")
    elif not identifiable["n"]:
        index = float(np.clip(PRIOR_N, *intervals["n"]))
        start = np.where(np.arange(fit.theta.size) == fit.theta.size + LOG_N1, np.log(index - 1.0), fit.theta)
        values, covered = values_at(fit_as(observations, index, chosen.model, start).fit.theta), None
        remarks.append(f"n is not identifiable from these photographs: {index:.3g} was chosen, intervals allow any n")
    if is_hidden(fit):
        remarks.append(HIDDEN)
    remarks += model_remarks(chosen.tails, chosen.coloured, chosen.model, intervals["nu"][0], chosen.failure)
    remarks += remarks_on_unknown(identifiable)
    return MaterialEstimate(
        name,
        pixels,
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


def _matte(fitted: Fitted, tested: LackOfFit | None, name: str, pixels: int, n: float | None) -> MaterialEstimate:
    """Estimate where no interface reflection was detected: β, γ and n unknown, the specular albedo bounded above."""
    fit, c = fitted.fit, channels_of(fitted.fit.theta)
    sweep, values = sweep_of_gloss(fit, n), values_at(fit.theta)
    intervals: dict[str, Any] = {
        "alpha": tuple(max(bound, 0.0) for bound in swept_interval(sweep, alpha)),
        **(OPEN_GLOSS if n is None else OPEN_GLOSS | {"n": (n, n)}),
        "specular_albedo": (0.0, min(swept_interval(sweep, albedo)[1], 1.0)),
        "body_colour": tuple(swept_interval(sweep, body_colour(channel)) for channel in range(c)),
    }
    alpha_identifiable = is_identifiable(values["alpha"], intervals["alpha"], (0.0, math.inf))
    return MaterialEstimate(
        name,
        pixels,
        standard_error=errors_of(fit, values, intervals) | dict.fromkeys((*GLOSS, "specular_albedo")),
        interval_95=intervals,
        correlation=correlation_of(fit),
        identifiable=dict.fromkeys((*GLOSS, "interface_colour"), False) | {"alpha": alpha_identifiable},
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


def _with_wide(chosen: ChosenFit, intervals: dict[str, Any]) -> dict[str, Any]:
    """`intervals` with those of ν and the interface colour of the wide fit, where the chosen one has none."""
    wide, c = chosen.wide.fit, channels_of(chosen.wide.fit.theta)
    missing: dict[str, Any] = {"nu": OPEN_GLOSS["nu"]}
    if wide.free[TAIL]:
        missing["nu"] = (1.0 / largest_tail(wide), math.inf)
    if c == 1:
        missing["interface_colour"] = ((1.0, 1.0),)
    elif wide.free[colour_slice(c)].any():
        missing["interface_colour"] = tuple(_student_interval(wide, colour_of_interface(i)) for i in range(c))
    return missing | intervals


def _student_interval(fit: MaterialFit, quantity: Quantity) -> tuple[float, float]:
    """95 % interval of `quantity`: the estimate and Student's t times its standard error."""
    (value,), (gradient,) = quantity(fit.theta[None])
    reach = student.ppf(0.975, degrees_of_freedom(fit, quantity)) * np.sqrt(gradient @ fit.covariance @ gradient)
    return float(value - reach), float(value + reach)


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
        remarks += [tested.remark(), WIDENED]
    if fitted.albedo_variation is not None and (fitted.albedo_variation.per_pixel or fitted.albedo_variation.failure):
        remarks.append(fitted.albedo_variation.remark())
    if profile is not None and not profile.statuses.converged.all():
        unsettled = int(np.sum(~profile.statuses.converged))
        remarks.append(
            f"the fit did not converge at {unsettled} of the {len(profile.rest)} refractive indices that the intervals "
            "rest on: they may be too narrow"
        )
    return remarks


def is_hidden(fit: MaterialFit) -> bool:
    """Whether a channel of the body is at its limit, 0."""
    return bool(np.any(fit.theta[: channels_of(fit.theta)] <= 0.0))


def is_open(fit: MaterialFit) -> bool:
    """Whether the strength of the highlight is known to worse than WELL_KNOWN of itself."""
    return bool(np.sqrt(fit.covariance[STRENGTH, STRENGTH]) > WELL_KNOWN * fit.theta[STRENGTH])


def profile_over_strength(fit: MaterialFit) -> Profile:
    """Profile of `fit` along β F₀, with the body that fits best at each; through its whole range where it is open."""
    place, best = fit.theta.size + STRENGTH, fit.theta[STRENGTH]
    spread = np.sqrt(inverse_over(fit.curvature, fit.free)[place, place] * inflation(fit, coordinate(STRENGTH)))
    near = best + spread * NODES
    nodes = np.unique(np.maximum(np.concatenate([near, best * STEPS]), 1e-9 * best))
    if not is_hidden(fit):
        nodes = best * np.append(OPEN_STEPS, 1.0)
        nodes.sort()
    starts = np.tile(fit.theta, (len(nodes), 1))
    starts[:, place] = nodes
    others = fit.free & (np.arange(fit.theta.size) != place)
    return profile_from(fit, place, starts, others)
