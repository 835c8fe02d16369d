"""Uncertainty of each parameter of a material: value, standard error, interval, and whether it is identifiable.

A parameter is identifiable when its 95 % interval lies inside the admissible range and corresponds to a relative
standard error of at most RELATIVE_LIMIT (of n − 1 for n, since the interface reflects in proportion to its square).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hagoromo.errors import InputError
from hagoromo.least_squares import NORMAL_95
from hagoromo.measurement.material.interval import Profile, interval, interval_of_n
from hagoromo.measurement.material.quantity import (
    Quantity,
    albedo_per_strength,
    alpha,
    body_colour,
    coordinate,
    log_albedo,
    log_beta,
    unpack_theta,
)
from hagoromo.measurement.material.sandwich import MaterialFit
from hagoromo.measurement.robust_fit import GAMMA_RANGE, N_RANGE
from hagoromo.measurement.sight import Array

RELATIVE_LIMIT = 0.25  # largest relative standard error of an identifiable parameter
ADMISSIBLE_N = (N_RANGE[0] - 1.0, N_RANGE[1] - 1.0)  # of n − 1
WIDTH_95 = 2 * NORMAL_95  # width of a 95 % interval in standard errors


def intervals_of(profile: Profile) -> dict[str, Any]:
    """95 % intervals of all reported quantities."""
    channels = len(profile.fit.theta) - 3
    return {
        "alpha": interval(profile, alpha),
        "beta": _exp(interval(profile, log_beta)),
        "gamma": _exp(interval(profile, coordinate(-2))),
        "n": tuple(1.0 + bound for bound in _exp(interval_of_n(profile))),
        "specular_albedo": _exp(interval(profile, log_albedo)),
        "body_colour": tuple(interval(profile, body_colour(channel)) for channel in range(channels)),
    }


def identifiable_of(fit: MaterialFit, intervals: dict[str, Any]) -> dict[str, bool]:
    """Which parameters are identifiable. A given n is not, nor is a β that only the admissible range of n bounds."""
    values, given = values_at(fit.theta), not fit.free[-1]
    n1 = tuple(bound - 1.0 for bound in intervals["n"])
    return {
        "alpha": is_identifiable(values["alpha"], intervals["alpha"], (0.0, math.inf)),
        "beta": is_identifiable(values["beta"], intervals["beta"], (0.0, math.inf))
        and (given or _inside(n1, ADMISSIBLE_N)),
        "gamma": is_identifiable(values["gamma"], intervals["gamma"], GAMMA_RANGE),
        "n": not given and is_identifiable(values["n"] - 1.0, n1, ADMISSIBLE_N),
    }


def errors_of(fit: MaterialFit | None, values: dict[str, Any], intervals: dict[str, Any]) -> dict[str, Any]:
    """Standard errors by the covariance of `fit`, or (None) those that correspond to the intervals."""
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


def correlation_of(fit: MaterialFit) -> tuple[tuple[float | None, ...], ...]:
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


def values_at(theta: Array) -> dict[str, Any]:
    """The parameters of θ, by their names in `MaterialEstimate`."""
    body, beta, gamma, n = unpack_theta(theta)
    mean = float(body.mean())
    if not mean > 0.0:
        raise InputError(f"its body reflects nothing (α = {mean:.2g}): there is no body colour to measure")
    return {
        "body_colour": tuple((body / mean).tolist()),
        "alpha": mean,
        "beta": beta,
        "gamma": gamma,
        "n": n,
        "specular_albedo": float(theta[-3] * albedo_per_strength(theta[None])[0][0]),
    }


def is_identifiable(value: float, bounds: tuple[float, ...], admissible: tuple[float, float]) -> bool:
    """Whether a 95 % interval lies inside the admissible range and is narrow enough for its value."""
    return _inside(bounds, admissible) and bool(bounds[1] - bounds[0] <= WIDTH_95 * RELATIVE_LIMIT * value)


def _inside(bounds: tuple[float, ...], admissible: tuple[float, float]) -> bool:
    return bool(bounds[0] > admissible[0] * (1 + 1e-6) and bounds[1] < admissible[1] * (1 - 1e-6))


def _exp(bounds: tuple[float, float]) -> tuple[float, float]:
    return math.exp(bounds[0]), math.exp(bounds[1])
