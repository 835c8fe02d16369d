"""Intervals of a material's parameters by profile likelihood over the refractive index.

β and n are correlated, and n may be poorly identifiable or not at all. So the fit is repeated along n through its
admissible range, and a value of a quantity q belongs to the 95 % interval when for some n

    Δχ²(n) + (q − q̂(n))² / var(q | n) ≤ t² κ,

where κ is the ratio of the variance of the robust estimate to that of the least squares it is computed with. κ follows
from the residuals, few of which may depend on q (for γ those of the highlight): t is Student's, with that many degrees
of freedom.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator
from scipy.stats import t as student

from hagoromo.least_squares.fit_status import FitStatuses
from hagoromo.measurement.facets import TAIL_RANGE
from hagoromo.measurement.material.quantity import Quantity, coordinate
from hagoromo.measurement.material.sandwich import MaterialFit, inverse_over
from hagoromo.measurement.parameters import LOG_N1, N_RANGE, STRENGTH, TAIL
from hagoromo.measurement.robust_fit import at_bound, minimise
from hagoromo.measurement.sight import Array

CHI_SQUARE_95 = 3.841458820694124  # 0.95 quantile of χ² with one degree of freedom
NODES = np.array([-4.5, -3.5, -2.7, -2.0, -1.4, -0.9, -0.4, 0.0, 0.4, 0.9, 1.4, 2.0, 2.7, 3.5, 4.5])  # standard errors
COARSE = 13  # points through the whole range of n
STRAIGHT = 1.0  # largest step along the direction of a profile for which it is taken to be straight
TAILS = 7  # points about the estimate of 1/ν, as far as the photographs allow
WELL_KNOWN = 0.25  # standard error of ln(n − 1) below which n is identifiable
SMALLEST_TAIL = 1e-9  # largest 1/ν of an interval at least: its reciprocal is finite
COARSE_TAILS = 6  # points through the whole range of 1/ν
FINE = 48  # points interpolated between two nodes of the profile
STEEP = 5.0  # Δχ² of a node just outside an interval, over what is allowed: with more there is a bend before it
BETWEEN, BISECTIONS = 8, 2  # points that are put there, and how often


@dataclass(frozen=True, eq=False)
class Profile:
    """The fit at K values of one parameter: rest (K,) is Δχ², theta (K, P), covariance (K, P, P) with it fixed.

    statuses: how the fit of each point ended. place: of the parameter in θ, ln(n − 1) or the tail 1/ν.
    """

    fit: MaterialFit
    rest: Array
    theta: Array
    covariance: Array
    statuses: FitStatuses
    place: int = LOG_N1

    @property
    def along(self) -> Array:
        """(K,) the parameter, increasing."""
        return self.theta[:, self.place]


def profile_over_n(fit: MaterialFit) -> Profile:
    """Profile of `fit` along n; one point where n was given."""
    nodes = _nodes(fit) if fit.free[LOG_N1] else fit.theta[LOG_N1:]
    return _profile(fit, LOG_N1, nodes, _without(fit, LOG_N1))


def profile_over_tail(fit: MaterialFit) -> Profile:
    """Profile of `fit` along 1/ν, from 0 to the largest value of its interval.

    n is free only where it is known well enough for its errors to be normal; `profile_over_n` has them anyway.
    """
    others = _without(fit, TAIL)
    others[LOG_N1] &= bool(fit.inside[LOG_N1] and fit.covariance[LOG_N1, LOG_N1] ** 0.5 < WELL_KNOWN)
    best, last = fit.theta[TAIL], 1.1 * largest_tail(fit)
    near = np.clip(np.linspace(2.0 * best - last, last, TAILS), *TAIL_RANGE)
    return _profile(fit, TAIL, np.unique(np.concatenate([[0.0, best], near])), others)


def _profile(fit: MaterialFit, place: int, nodes: Array, others: NDArray[np.bool_]) -> Profile:
    """Profile along the parameter at `place`, at `nodes` (K,), over the parameters `others` (P,)."""
    return profile_from(fit, place, _starts(fit, place, nodes), others)


def profile_from(fit: MaterialFit, place: int, starts: Array, others: NDArray[np.bool_]) -> Profile:
    """Profile at the values that `starts` (K, P) have at `place`, from there, over the parameters `others` (P,).

    Where Δχ² leaves what an interval allows by a bend, as where a body comes to its limit, nodes are added.
    """
    profile, limit = _settled(fit, place, starts, others), allowance(fit, coordinate(place))
    for _ in range(BISECTIONS):
        inside = profile.rest <= limit
        left = np.nonzero((inside[1:] != inside[:-1]) & (np.fmax(profile.rest[1:], profile.rest[:-1]) > STEEP * limit))[
            0
        ]
        if not left.size:
            break
        more = []
        for k in left:
            row = np.tile(profile.theta[k if inside[k] else k + 1], (BETWEEN, 1))
            row[:, place] = np.linspace(profile.along[k], profile.along[k + 1], BETWEEN + 2)[1:-1]
            more.append(row)
        starts = np.concatenate([profile.theta, *more])
        profile = _settled(fit, place, starts[np.argsort(starts[:, place], kind="stable")], others)
    return profile


def _settled(fit: MaterialFit, place: int, starts: Array, others: NDArray[np.bool_]) -> Profile:
    """The profile at the values of `starts` alone."""
    rows = minimise(fit.objective, starts, others)
    pairs = zip(rows.curvature, rows.theta, strict=True)
    covariance = np.stack([inverse_over(curvature, others & ~at_bound(theta)) for curvature, theta in pairs])
    best = fit.objective.evaluate(fit.theta[None])[0][0]
    return Profile(fit, np.maximum(2.0 * (rows.cost - best), 0.0), rows.theta, covariance, rows.statuses, place)


def _nodes(fit: MaterialFit) -> Array:
    """Values of ln(n − 1): near the estimate by its standard error, and through the whole range."""
    low, high = np.log(np.subtract(N_RANGE, 1.0))
    near = fit.theta[-1] + np.sqrt(fit.covariance[-1, -1]) * NODES
    return np.unique(np.concatenate([np.clip(near, low, high), np.linspace(low, high, COARSE)]))


def _starts(fit: MaterialFit, place: int, nodes: Array) -> Array:
    """Starts (K, P) of a profile with θ[place] at `nodes`: along its direction dθ/dθ[place] at the estimate.

    The direction is 0 where the estimate is at the end of its range, and where the parameter has no effect.
    """
    inverse, along = inverse_over(fit.curvature, fit.inside), np.zeros_like(fit.theta)
    if fit.inside[place] and inverse[place, place] > 0.0:
        along = inverse[:, place] / inverse[place, place]
    starts = fit.theta + np.clip(nodes - fit.theta[place], -STRAIGHT, STRAIGHT)[:, None] * along
    starts[:, place] = nodes
    return starts


def interval(profile: Profile, quantity: Quantity) -> tuple[float, float]:
    """95 % interval of `quantity`."""
    values, gradients = quantity(profile.theta)
    spread = np.sqrt(np.einsum("kp,kpq,kq->k", gradients, profile.covariance, gradients))
    limit = allowance(profile.fit, quantity)
    if len(values) == 1:
        return float(values[0] - spread[0] * limit**0.5), float(values[0] + spread[0] * limit**0.5)
    u = _fine(profile.along)
    rest, value, spread = (_smooth(profile, q)(u) for q in (profile.rest, values, spread))
    inside = rest <= max(limit, float(rest.min()))
    reach = spread[inside] * np.sqrt(np.maximum(limit - rest[inside], 0.0))
    return float(np.min(value[inside] - reach)), float(np.max(value[inside] + reach))


def interval_of_n(profile: Profile) -> tuple[float, float]:
    """95 % interval of ln(n − 1), cut off at the admissible range."""
    fit = profile.fit
    if len(profile.rest) == 1:
        return float(fit.theta[-1]), float(fit.theta[-1])
    limit = allowance(fit, coordinate(-1))
    u = _fine(profile.along)
    inside = u[_smooth(profile, profile.rest)(u) <= limit]
    return float(inside[0]), float(inside[-1])


def interval_of_tail(fit: MaterialFit) -> tuple[float, float]:
    """95 % interval of 1/ν, by the profile along it; 0, Gaussian facets, may belong to it.

    Where 1/ν = 0 is the estimate, κ is that of β F₀.
    """
    spread = np.sqrt(inverse_over(fit.curvature, fit.free)[TAIL, TAIL] * inflation(fit, coordinate(TAIL)))
    near = np.clip(fit.theta[TAIL] + spread * NODES[1::2], *TAIL_RANGE)
    nodes = np.unique(np.concatenate([near, np.linspace(*TAIL_RANGE, COARSE_TAILS)]))
    rows = minimise(fit.objective, _starts(fit, TAIL, nodes), _without(fit, TAIL))
    best = min(fit.objective.evaluate(fit.theta[None])[0][0], rows.cost.min())
    u = _fine(nodes)
    inside = u[PchipInterpolator(nodes, 2.0 * (rows.cost - best))(u) <= allowance(fit, coordinate(TAIL))]
    low, high = (inside[0], inside[-1]) if inside.size else (fit.theta[TAIL],) * 2
    return float(low), float(high)


def largest_tail(fit: MaterialFit) -> float:
    """Largest 1/ν of its 95 % interval, to second order about the estimate, which may be 0.

    The end of the range where tails have no effect on the photographs.
    """
    _, (gradient,), (curvature,) = fit.objective.evaluate(fit.theta[None])
    inside = fit.inside.copy()
    inside[TAIL] = True
    spread = float(inverse_over(curvature, inside)[TAIL, TAIL])
    if not spread > 0.0:
        return TAIL_RANGE[1]
    own = 1.0 / spread
    slope, limit = max(float(gradient[TAIL]), 0.0), allowance(fit, coordinate(TAIL))
    # 2 (slope · step + own · step²/2) = limit, without a difference of nearly equal numbers
    step = limit / max(np.sqrt(slope**2 + own * limit) + slope, 1e-300)
    return float(min(max(fit.theta[TAIL] + step, SMALLEST_TAIL), TAIL_RANGE[1]))


def _without(fit: MaterialFit, place: int) -> NDArray[np.bool_]:
    """(P,) the parameters that are estimated, but for the one at `place`."""
    others = fit.free.copy()
    others[place] = False
    return others


def allowance(fit: MaterialFit, quantity: Quantity) -> float:
    """t² κ: the rise of χ² that the 95 % interval of `quantity` allows."""
    return float(student.ppf(0.975, degrees_of_freedom(fit, quantity)) ** 2) * inflation(fit, quantity)


def degrees_of_freedom(fit: MaterialFit, quantity: Quantity) -> float:
    """Of the sandwich variance of `quantity`: (Σ w)² / Σ w² of the groups' shares w in it (Satterthwaite 1946)."""
    gradient = quantity(fit.theta[None])[1][0]
    share = np.bincount(fit.group, (fit.influence @ gradient) ** 2)
    return float(share.sum() ** 2 / np.sum(share**2)) if share.any() else np.inf


def inflation(fit: MaterialFit, quantity: Quantity) -> float:
    """κ: variance of the robust estimate of `quantity` over its variance in the frozen least squares.

    Where the estimate is at a limit of its range or has no effect, so that neither has a variance, κ is that of β F₀,
    and 1 where that has none either.
    """
    gradient, inverse = quantity(fit.theta[None])[1][0] * fit.inside, inverse_over(fit.curvature, fit.inside)
    if not gradient @ inverse @ gradient > 0.0:
        gradient = np.eye(len(fit.theta))[STRENGTH]
    bread = float(gradient @ inverse @ gradient)
    return float(gradient @ fit.covariance @ gradient) / bread if bread > 0.0 else 1.0


def _fine(nodes: Array) -> Array:
    return np.interp(np.arange((len(nodes) - 1) * FINE + 1) / FINE, np.arange(len(nodes)), nodes)


def _smooth(profile: Profile, values: Array) -> PchipInterpolator:
    return PchipInterpolator(profile.along, values)
