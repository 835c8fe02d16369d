"""From the fit of a material to its estimate: intervals, what is identifiable, and what is said where it is not.

A parameter counts as identifiable when its 95 % interval closes inside the admissible range and amounts to a relative
standard error of RELATIVE_LIMIT at most (of n − 1 for n: that is what the interface reflects by). Before that, the
interface term must be detected at all: χ² must fall by more than noise lets it over all γ and n.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from hagoromo.errors import InputError
from hagoromo.reflectance.material.faint_gloss import albedo, sweep_of_gloss, swept_interval
from hagoromo.reflectance.material.interval import Profile, inflation, interval, interval_of_n, profile_over_n
from hagoromo.reflectance.material.lack_of_fit import LackOfFit, lack_of_fit
from hagoromo.reflectance.material.material_estimate import MaterialEstimate
from hagoromo.reflectance.material.material_fit import (
    MaterialFit,
    fit_material,
    with_colour_error,
)
from hagoromo.reflectance.material.quantity import (
    Quantity,
    albedo_per_strength,
    alpha,
    body_colour,
    coordinate,
    log_albedo,
    log_beta,
)
from hagoromo.reflectance.material.texture import Texture, find_texture
from hagoromo.reflectance.observations import Observations
from hagoromo.reflectance.robust_fit import GAMMA_RANGE, N_RANGE, minimise
from hagoromo.reflectance.sight import Array

RELATIVE_LIMIT = 0.25  # largest relative standard error of an identifiable parameter
DETECTION = 21.1  # fall of χ² that noise reaches with probability 1e-4 for three parameters
ADMISSIBLE_N = (N_RANGE[0] - 1.0, N_RANGE[1] - 1.0)  # of n − 1
PRIOR_N = 1.5  # most dielectrics, plastic, skin and fibre among them: 1.3–1.7
WIDTH_95 = 2 * 1.959964  # of a 95 % interval, in standard errors


def estimate_material(
    seen: Observations, name: str, pixels: int, n: float | None = None, white_error: Array | None = None
) -> MaterialEstimate:
    """α, β, γ, n and body colour of what is `seen`.

    n: refractive index where it is known. white_error: (C, C) covariance of ln white, where that was estimated.
    `InputError` that names the material when there is too little to fit or the fit does not settle.
    """
    error = np.zeros((seen.channels, seen.channels)) if white_error is None else white_error
    try:
        found = _fitted(seen, error, n)
        if _detected(found.fit):
            return _glossy(seen, found, name, pixels, error)
        return _matte(_fitted(seen, error, n, with_interface=False), name, pixels, n)
    except InputError as wrong:
        raise InputError(f"{name}: {wrong}") from wrong


class Fitted(NamedTuple):
    """A fit, with one body colour or each pixel's own, and what was found of the latter."""

    fit: MaterialFit
    texture: Texture | None


def _fitted(seen: Observations, error: Array, n: float | None, with_interface: bool = True) -> Fitted:
    fit, texture = find_texture(fit_material(seen, n, with_interface))
    return Fitted(with_colour_error(fit, error), texture)


def _detected(fit: MaterialFit) -> bool:
    """Whether χ² falls by more than DETECTION, in units of what noise does, when the interface term is added."""
    c = len(fit.theta) - 3
    if fit.theta[c] <= 0.0:
        return False
    without = np.where(np.arange(c + 3) == c, 0.0, fit.theta)[None]
    cost = minimise(fit.objective, without, np.arange(c + 3) < c).cost[0]
    fall = 2.0 * (cost - fit.objective.at(fit.theta[None])[0][0])
    return bool(fall > DETECTION * inflation(fit, coordinate(c)))


def _glossy(seen: Observations, found: Fitted, name: str, pixels: int, error: Array) -> MaterialEstimate:
    """Estimate with the interface term: n estimated, given, or unknown and then chosen."""
    fit = found.fit
    intervals = _intervals(profile_over_n(fit))
    identifiable = _identifiable(fit, intervals)
    tested = lack_of_fit(fit)
    remarks, values, covered = _remarks(found, tested), _values(fit.theta), fit
    if not fit.free[-1]:
        remarks.append(f"n = {values['n']:.4g} was given, not measured")
    elif not identifiable["n"]:
        chosen = float(np.clip(PRIOR_N, *intervals["n"]))
        values, covered = _values(_fitted(seen, error, chosen).fit.theta), None
        remarks.append(f"n is not told by these photographs: {chosen:.3g} was chosen, the intervals hold for all n")
    unknown = [key for key in ("alpha", "beta", "gamma") if not identifiable[key]]
    if unknown:
        remarks.append(f"not told by these photographs: {', '.join(unknown)}")
    return MaterialEstimate(
        name,
        pixels,
        interface_colour=(1.0,) * seen.channels,
        standard_error=_errors(covered, values, intervals),
        interval_95=intervals,
        correlation=_correlation(fit),
        identifiable=identifiable,
        chi_square=fit.residuals.chi_square,
        remarks=tuple(remarks),
        lack_of_fit=None if tested is None else tested.record(),
        texture=None if found.texture is None else found.texture.record(),
        **values,
    )


def _intervals(profile: Profile) -> dict[str, Any]:
    """95 % intervals of every quantity that is reported."""
    channels = len(profile.fit.theta) - 3
    return {
        "alpha": interval(profile, alpha),
        "beta": _exp(interval(profile, log_beta)),
        "gamma": _exp(interval(profile, coordinate(-2))),
        "n": tuple(1.0 + bound for bound in _exp(interval_of_n(profile))),
        "specular_albedo": _exp(interval(profile, log_albedo)),
        "body_colour": tuple(interval(profile, body_colour(channel)) for channel in range(channels)),
    }


def _identifiable(fit: MaterialFit, intervals: dict[str, Any]) -> dict[str, bool]:
    """Which parameters the photographs tell; a given n is not told, a β that only the range of n bounds neither."""
    values, given = _values(fit.theta), not fit.free[-1]
    n1 = tuple(bound - 1.0 for bound in intervals["n"])
    return {
        "alpha": _tells(values["alpha"], intervals["alpha"], (0.0, math.inf)),
        "beta": _tells(values["beta"], intervals["beta"], (0.0, math.inf)) and (given or _inside(n1, ADMISSIBLE_N)),
        "gamma": _tells(values["gamma"], intervals["gamma"], GAMMA_RANGE),
        "n": not given and _tells(values["n"] - 1.0, n1, ADMISSIBLE_N),
    }


def _matte(found: Fitted, name: str, pixels: int, n: float | None) -> MaterialEstimate:
    """Estimate where no interface reflection was detected: β, γ and n unknown, the specular albedo bounded."""
    fit, c = found.fit, len(found.fit.theta) - 3
    sweep, values = sweep_of_gloss(fit, n), _values(fit.theta)
    intervals: dict[str, Any] = {
        "alpha": swept_interval(sweep, alpha),
        "beta": (0.0, math.inf),
        "gamma": GAMMA_RANGE,
        "n": N_RANGE if n is None else (n, n),
        "specular_albedo": (0.0, min(swept_interval(sweep, albedo)[1], 1.0)),
        "body_colour": tuple(swept_interval(sweep, body_colour(channel)) for channel in range(c)),
    }
    told = _tells(values["alpha"], intervals["alpha"], (0.0, math.inf))
    tested = lack_of_fit(fit)
    return MaterialEstimate(
        name,
        pixels,
        interface_colour=(1.0,) * c,
        standard_error=_errors(fit, values, intervals) | dict.fromkeys(("beta", "gamma", "n", "specular_albedo")),
        interval_95=intervals,
        correlation=_correlation(fit),
        identifiable={"alpha": told, "beta": False, "gamma": False, "n": False},
        chi_square=fit.residuals.chi_square,
        remarks=(
            *_remarks(found, tested),
            "no interface reflection was detected: beta, gamma and n are not told by these photographs",
        ),
        lack_of_fit=None if tested is None else tested.record(),
        texture=None if found.texture is None else found.texture.record(),
        **values,
    )


def _values(theta: Array) -> dict[str, Any]:
    """The parameters at θ, by their names in `MaterialEstimate`."""
    body, n = theta[:-3], 1.0 + math.exp(theta[-1])
    mean = float(body.mean())
    if not mean > 0.0:
        raise InputError(f"its body reflects nothing (α = {mean:.2g}): there is no body colour to measure")
    return {
        "body_colour": tuple((body / mean).tolist()),
        "alpha": mean,
        "beta": float(theta[-3]) * ((n + 1.0) / (n - 1.0)) ** 2,
        "gamma": math.exp(theta[-2]),
        "n": n,
        "specular_albedo": float(theta[-3] * albedo_per_strength(theta[None])[0][0]),
    }


def _errors(fit: MaterialFit | None, values: dict[str, Any], intervals: dict[str, Any]) -> dict[str, Any]:
    """Standard errors by the covariance of `fit`, or (None) those that the intervals amount to."""
    if fit is None:
        widths = {
            key: np.diff(np.array(interval, np.float64), axis=-1)[..., 0] / WIDTH_95
            for key, interval in intervals.items()
        }
        return {key: tuple(width.tolist()) if width.ndim else float(width) for key, width in widths.items()}

    def error(quantity: Quantity) -> float:
        gradient = quantity(fit.theta[None])[1][0]
        return float(np.sqrt(gradient @ fit.covariance @ gradient))

    return {
        "alpha": error(alpha),
        "beta": values["beta"] * error(log_beta),
        "gamma": values["gamma"] * error(coordinate(-2)),
        "n": (values["n"] - 1.0) * error(coordinate(-1)) if fit.inside[-1] else None,
        "specular_albedo": values["specular_albedo"] * error(log_albedo),
        "body_colour": tuple(error(body_colour(channel)) for channel in range(len(fit.theta) - 3)),
    }


def _correlation(fit: MaterialFit) -> tuple[tuple[float | None, ...], ...]:
    """Correlation of α, β, γ, n (in the order of PARAMETERS), None where one was not estimated."""
    quantities = (alpha, log_beta, coordinate(-2), coordinate(-1))
    gradients = np.stack([quantity(fit.theta[None])[1][0] for quantity in quantities])
    covariance = gradients @ fit.covariance @ gradients.T
    spread = np.sqrt(np.diag(covariance))
    known = np.outer(spread, spread) > 0.0
    correlation = np.divide(covariance, np.outer(spread, spread), out=np.zeros_like(covariance), where=known)
    return tuple(
        tuple(r if k else None for r, k in zip(*row, strict=True))
        for row in zip(correlation.tolist(), known, strict=True)
    )


def _tells(value: float, bounds: tuple[float, ...], admissible: tuple[float, float]) -> bool:
    """Whether a 95 % interval closes inside the admissible range and is narrow enough for its value."""
    return _inside(bounds, admissible) and bool(bounds[1] - bounds[0] <= WIDTH_95 * RELATIVE_LIMIT * value)


def _inside(bounds: tuple[float, ...], admissible: tuple[float, float]) -> bool:
    return bool(bounds[0] > admissible[0] * (1 + 1e-6) and bounds[1] < admissible[1] * (1 - 1e-6))


def _remarks(found: Fitted, tested: LackOfFit | None) -> list[str]:
    """What the residuals say of the model."""
    residuals, remarks = found.fit.residuals, []
    if residuals.model_error:
        remarks.append(
            f"the model lacks: residuals are {residuals.scale:.3g} times the noise (χ² per degree of freedom "
            f"{residuals.chi_square:.3g}); a model error of {100 * residuals.model_error:.2g} % joined the variance"
        )
    if residuals.outliers > 0.001:
        remarks.append(f"{100 * residuals.outliers:.2g} % of the values lie beyond 6 standard deviations")
    if tested is not None and tested.rejected:
        remarks.append(tested.remark())
    if found.texture is not None and found.texture.per_pixel:
        remarks.append(found.texture.remark())
    return remarks


def _exp(bounds: tuple[float, float]) -> tuple[float, float]:
    return math.exp(bounds[0]), math.exp(bounds[1])
