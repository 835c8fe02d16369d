"""Uncertainty of each parameter of a material: value, standard error, interval, and whether it is identifiable.

A parameter is identifiable when its 95 % interval lies inside the admissible range and corresponds to a relative
standard error of at most RELATIVE_LIMIT (of n − 1 for n, since the interface reflects in proportion to its square).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from hagoromo.least_squares.loss import NORMAL_95, exp_or_infinity
from hagoromo.measurement.facets import TAIL_RANGE
from hagoromo.measurement.material.interval import Profile, interval, interval_of_n, interval_of_tail
from hagoromo.measurement.material.quantity import (
    Quantity,
    albedo_per_strength,
    alpha,
    body_colour,
    colour_of_interface,
    coordinate,
    log_albedo,
    log_beta,
)
from hagoromo.measurement.material.sandwich import MaterialFit
from hagoromo.measurement.parameters import (
    GAMMA_RANGE,
    LOG_GAMMA,
    LOG_N1,
    N_RANGE,
    TAIL,
    channels_of,
    colour_slice,
    unpack_theta,
)
from hagoromo.measurement.sight import Array
from hagoromo.reflectance.parameters import STATED
from hagoromo.reflectance.torrance_sparrow import normal_fresnel

RELATIVE_LIMIT = 0.25  # largest relative standard error of an identifiable parameter
ADMISSIBLE_N = (N_RANGE[0] - 1.0, N_RANGE[1] - 1.0)  # of n − 1
NEARLY_GAUSSIAN = 0.1  # 1/ν of facets that differ little from Gaussian ones
WIDTH_95 = 2 * NORMAL_95  # width of a 95 % interval in standard errors


def intervals_of(profile: Profile, over_tails: Profile | None = None) -> dict[str, Any]:
    """95 % intervals of all reported quantities; of nu and the interface colour only where they were estimated.

    over_tails: profile along 1/ν of a fit with tails, where Gaussian facets were chosen. An interval then has what the
    tails that the photographs allow would give, too.
    """
    intervals = _intervals(profile)
    if over_tails is None:
        return intervals
    other = _intervals(over_tails)
    given = {"n": intervals["n"]} if not profile.fit.free[LOG_N1] else {}
    return {key: _joined(bounds, other[key]) for key, bounds in intervals.items()} | given


def _joined(one: Any, other: Any) -> Any:
    """The smallest interval that has both, or one per channel."""
    if isinstance(one[0], tuple):
        return tuple(_joined(*pair) for pair in zip(one, other, strict=True))
    return min(one[0], other[0]), max(one[1], other[1])


def _intervals(profile: Profile) -> dict[str, Any]:
    fit, channels = profile.fit, channels_of(profile.fit.theta)
    along_n = profile.place == LOG_N1
    shape: dict[str, Any] = {"nu": nu_interval(interval_of_tail(fit))} if fit.free[TAIL] and along_n else {}
    if fit.free[colour_slice(channels)].any():
        shape["interface_colour"] = tuple(interval(profile, colour_of_interface(c)) for c in range(channels))
    return shape | {
        "alpha": _above_nothing(interval(profile, alpha)),
        "beta": _exp(interval(profile, log_beta)),
        "gamma": _within(_exp(interval(profile, coordinate(LOG_GAMMA))), GAMMA_RANGE),
        "n": tuple(1.0 + bound for bound in _exp(interval_of_n(profile) if along_n else _index_interval(profile))),
        "specular_albedo": _exp(interval(profile, log_albedo)),
        "body_colour": tuple(interval(profile, body_colour(channel)) for channel in range(channels)),
    }


def intervals_of_hidden(profile: Profile) -> dict[str, Any]:
    """Those of a body that may be black: its colour may be any of mean 1. profile: along β F₀."""
    c = channels_of(profile.fit.theta)
    return {
        "alpha": (0.0, max(interval(profile, alpha)[1], 0.0)),
        "beta": _exp(interval(profile, log_beta)),
        "gamma": _within(_exp(interval(profile, coordinate(LOG_GAMMA))), GAMMA_RANGE),
        "n": tuple(1.0 + bound for bound in _exp(_index_interval(profile))),
        "specular_albedo": _exp(interval(profile, log_albedo)),
        "body_colour": ((0.0, float(c)),) * c,
    }


def with_open_strength(intervals: dict[str, Any], profile: Profile) -> dict[str, Any]:
    """`intervals` with what belongs to them along `profile`, over the strength of a highlight; n stays as it is."""
    other = {key: bounds for key, bounds in _intervals(profile).items() if key != "n"}
    return intervals | {key: _joined(intervals[key], bounds) for key, bounds in other.items()}


def _above_nothing(bounds: tuple[float, float]) -> tuple[float, float]:
    """The bounds of α: no body reflects less than nothing."""
    return max(bounds[0], 0.0), max(bounds[1], 0.0)


def _index_interval(profile: Profile) -> tuple[float, float]:
    """That of ln(n − 1) within its admissible range, of a profile along 1/ν."""
    low, high = np.clip(interval(profile, coordinate(LOG_N1)), *np.log(ADMISSIBLE_N))
    return float(low), float(high)


def nu_interval(tail: tuple[float, float]) -> tuple[float, float]:
    """The interval of ν for one of 1/ν; it reaches to infinity where that of 1/ν reaches to 0."""
    return 1.0 / tail[1] if tail[1] > 0.0 else math.inf, 1.0 / tail[0] if tail[0] > 0.0 else math.inf


def identifiable_of(fit: MaterialFit, intervals: dict[str, Any]) -> dict[str, bool]:
    """Which parameters are identifiable. A given n is not, nor is a β that only the admissible range of n bounds.

    ν is judged by 1/ν, whose error counts against at least NEARLY_GAUSSIAN. An interface colour is one number per
    channel, of mean 1, and each error counts against 1.
    """
    values, given = values_at(fit.theta), not fit.free[-1]
    tail = tuple(1.0 / bound for bound in reversed(intervals["nu"])) if "nu" in intervals else (0.0, math.inf)
    colours = intervals.get("interface_colour", ((0.0, math.inf),))
    n1 = tuple(bound - 1.0 for bound in intervals["n"])
    return {
        "alpha": is_identifiable(values["alpha"], intervals["alpha"], (0.0, math.inf)),
        "beta": is_identifiable(values["beta"], intervals["beta"], (0.0, math.inf))
        and (given or _inside(n1, ADMISSIBLE_N)),
        "gamma": is_identifiable(values["gamma"], intervals["gamma"], GAMMA_RANGE),
        "n": not given and is_identifiable(values["n"] - 1.0, n1, ADMISSIBLE_N),
        "nu": tail[1] < TAIL_RANGE[1] * (1 - 1e-6)
        and tail[1] - tail[0] <= WIDTH_95 * RELATIVE_LIMIT * max(1.0 / values["nu"], NEARLY_GAUSSIAN),
        "interface_colour": all(high - low <= WIDTH_95 * RELATIVE_LIMIT for low, high in colours),
    }


def remarks_on_unknown(identifiable: Mapping[str, bool]) -> list[str]:
    """One line if the photographs leave α, β or γ open; n has a remark of its own."""
    unknown = [key for key in STATED if key != "n" and not identifiable[key]]
    return [f"not identifiable from these photographs: {', '.join(unknown)}"] if unknown else []


def errors_of(fit: MaterialFit | None, values: dict[str, Any], intervals: dict[str, Any]) -> dict[str, Any]:
    """Standard errors by the covariance of `fit`, or (None) those that correspond to the intervals."""
    if fit is None:
        intervals = {key: bounds for key, bounds in intervals.items() if key != "nu" or math.isfinite(values["nu"])}
        widths = {
            key: np.diff(np.array(interval, np.float64), axis=-1)[..., 0] / WIDTH_95
            for key, interval in intervals.items()
        }
        known = {key: width for key, width in widths.items() if np.isfinite(width).all()}
        return dict.fromkeys(widths) | {
            key: tuple(width.tolist()) if width.ndim else float(width) for key, width in known.items()
        }

    def error(quantity: Quantity) -> float:
        gradient = quantity(fit.theta[None])[1][0]
        return float(np.sqrt(gradient @ fit.covariance @ gradient))

    return {
        "alpha": error(alpha),
        "beta": values["beta"] * error(log_beta),
        "gamma": values["gamma"] * error(coordinate(LOG_GAMMA)),
        "n": (values["n"] - 1.0) * error(coordinate(LOG_N1)) if fit.inside[LOG_N1] else None,
        "nu": values["nu"] ** 2 * error(coordinate(TAIL)) if fit.inside[TAIL] else None,
        "interface_colour": tuple(error(colour_of_interface(channel)) for channel in range(channels_of(fit.theta)))
        if fit.free[colour_slice(channels_of(fit.theta))].any()
        else None,
        "specular_albedo": values["specular_albedo"] * error(log_albedo),
        "body_colour": tuple(error(body_colour(channel)) for channel in range(channels_of(fit.theta))),
    }


def correlation_of(fit: MaterialFit) -> tuple[tuple[float | None, ...], ...]:
    """Correlation of α, β, γ, n (in the order of PARAMETERS), None where one was not estimated."""
    quantities = (alpha, log_beta, coordinate(LOG_GAMMA), coordinate(LOG_N1))
    gradients = np.stack([quantity(fit.theta[None])[1][0] for quantity in quantities])
    covariance = gradients @ fit.covariance @ gradients.T
    spread = np.sqrt(np.diag(covariance))
    known = np.outer(spread, spread) > 0.0
    correlation = np.divide(covariance, np.outer(spread, spread), out=np.zeros_like(covariance), where=known)
    return tuple(
        tuple(r if k else None for r, k in zip(*row, strict=True))
        for row in zip(correlation.tolist(), known, strict=True)
    )


def values_at(theta: Array) -> dict[str, Any]:
    """The parameters of θ, by their names in `MaterialEstimate`."""
    body, beta, gamma, n, nu, colour = unpack_theta(theta)
    mean = float(body.mean())
    return {
        "body_colour": tuple((body / mean).tolist()) if mean > 0.0 else (1.0,) * len(body),
        "alpha": mean,
        "beta": beta,
        "gamma": gamma,
        "n": n,
        "nu": nu,
        "interface_colour": tuple(colour.tolist()),
        "specular_albedo": beta * normal_fresnel(n) * float(albedo_per_strength(theta[None])[0][0]),
    }


def is_identifiable(value: float, bounds: tuple[float, ...], admissible: tuple[float, float]) -> bool:
    """Whether a 95 % interval lies inside the admissible range and is narrow enough for its value."""
    return _inside(bounds, admissible) and bool(bounds[1] - bounds[0] <= WIDTH_95 * RELATIVE_LIMIT * value)


def _inside(bounds: tuple[float, ...], admissible: tuple[float, float]) -> bool:
    return bool(bounds[0] > admissible[0] * (1 + 1e-6) and bounds[1] < admissible[1] * (1 - 1e-6))


def _within(bounds: tuple[float, float], admissible: tuple[float, float]) -> tuple[float, float]:
    """The bounds, none of them beyond the admissible range."""
    low, high = np.clip(bounds, *admissible)
    return float(low), float(high)


def _exp(bounds: tuple[float, float]) -> tuple[float, float]:
    low, high = (exp_or_infinity(bound) for bound in bounds)
    return low, high
