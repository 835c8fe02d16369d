"""The fit of one material with the sandwich covariance of its estimate and the influence of each value.

Rows θ are those of `parameters`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hagoromo.least_squares.fit_status import FitStatus
from hagoromo.measurement.material.material_objective import MaterialObjective
from hagoromo.measurement.robust_fit import at_bound
from hagoromo.measurement.sight import Array

OUTLIER = 6.0  # standard deviations
LEAST_EFFECT = 1e-100  # curvature of a parameter below which it has no effect: squares of its inverse are still finite
LEAST_CURVATURE = 1e-14  # of a direction, where that of each parameter is 1: below is rounding


@dataclass(frozen=True)
class Residuals:
    """Residuals of a fit.

    scale: robust standard deviation of the residuals, in stated standard deviations. model_error: relative error of
    the model that explains a scale above INCOMPLETE_SCALE, else 0. chi_square: per degree of freedom, of all values.
    outliers: share of the values beyond 6 of the standard deviations that the fit used.
    """

    scale: float
    model_error: float
    chi_square: float
    outliers: float


@dataclass(frozen=True, eq=False)
class MaterialFit:
    """Estimate θ (P,) of one material with all that its intervals need.

    objective: the least squares, frozen at the estimate, and its weight W (N, C). curvature: (P, P) JᵀWJ. covariance:
    (P, P), sandwich. free: (P,) estimated parameters. inside: (P,) those that are not at a limit of their range.
    status: how the rounds of the fit ended; steps are rounds, the last step is in standard errors.
    influence: (V, P) of each used value on the estimate, for a residual of usual size; group: (V,) equal for values
    whose residuals the sandwich takes to be correlated.
    """

    theta: Array
    objective: MaterialObjective
    weight: Array
    curvature: Array
    covariance: Array
    free: NDArray[np.bool_]
    inside: NDArray[np.bool_]
    residuals: Residuals
    status: FitStatus
    influence: Array
    group: NDArray[np.intp]


def with_covariance(
    objective: MaterialObjective,
    theta: Array,
    free: NDArray[np.bool_],
    scale: float,
    model_error: float,
    status: FitStatus,
) -> MaterialFit:
    """The fit with weights frozen where they are, and the sandwich covariance A⁻¹BA⁻¹ of the estimate (Huber 1981).

    A = Σ ρ'' jjᵀ/v and B = Σ ρ'² jjᵀ/v, each term divided by 1 − its leverage. If the model is incomplete, residuals of
    neighbours are correlated: B then sums ρ' j/√v over each image tile before it squares. Errors that all values share
    (`Observations.shared`) move the estimate as values that change by so much do, and are added.
    """
    observations, inside = objective.observations, free & ~at_bound(theta)
    used = observations.used
    model = objective.model(theta)
    deviation = (observations.values - model)[used]
    r = deviation / np.sqrt(objective.variance[used])
    j = objective.jacobian(theta)[used][:, inside] / np.sqrt(objective.variance[used])[:, None]
    a = np.einsum("m,mp,mq->pq", objective.loss.curvature(r), j, j)
    inverse = np.linalg.pinv(a, hermitian=True)
    own = objective.own_leverage()[used]
    leverage = objective.loss.weight(r) * np.einsum("mp,pq,mq->m", j, inverse, j) + own
    score = j * (r * objective.loss.weight(r) / np.sqrt(np.maximum(1.0 - leverage, 0.1)))[:, None]
    group = np.arange(len(score))
    if model_error:
        group = np.unique(np.broadcast_to(observations.tile[:, None], used.shape)[used], return_inverse=True)[1]
        score = np.stack([np.bincount(group, column) for column in score.T], axis=1)
    covariance, influence = np.zeros((theta.size, theta.size)), np.zeros((len(group), theta.size))
    weight = objective.loss.weight(r)
    influence[:, inside] = np.sqrt(np.mean((r * weight) ** 2)) * (j * (weight > 0.0)[:, None]) @ inverse
    covariance[np.ix_(inside, inside)] = inverse @ (score.T @ score) @ inverse
    if observations.shared is not None:
        common = observations.shared[used] / np.sqrt(objective.variance[used])[:, None]
        moved = inverse @ (j.T @ (objective.loss.curvature(r)[:, None] * common))
        covariance[np.ix_(inside, inside)] += moved @ moved.T
    weights = np.zeros_like(observations.values)
    weights[used] = objective.loss.weight(r)
    frozen = replace(objective, weights=weights)
    curvature = frozen.evaluate(theta[None])[2][0]
    squared = deviation**2 / observations.variance_at(model)[used]
    chi_square = float(np.sum(squared) / (squared.size - np.sum(inside) - np.sum(own)))
    residuals = Residuals(scale, model_error, chi_square, float(np.mean(np.abs(r) > OUTLIER)))
    return MaterialFit(
        theta,
        frozen,
        weights / objective.variance,
        curvature,
        covariance,
        free,
        inside,
        residuals,
        status,
        influence,
        group,
    )


def with_colour_error(fit: MaterialFit, error: Array) -> MaterialFit:
    """`fit` with the error of the lamp's colour in its covariance; error: (C, C) covariance of ln white.

    An error δ of ln white changes every model value by itself times δ, and the estimate by H⁻¹JᵀW times that.
    """
    change = np.einsum("ncp,nc->pc", fit.objective.jacobian(fit.theta), fit.weight * fit.objective.model(fit.theta))
    gain = inverse_over(fit.curvature, fit.inside) @ change
    return replace(fit, covariance=fit.covariance + gain @ error @ gain.T)


def inverse_over(curvature: Array, free: NDArray[np.bool_]) -> Array:
    """Inverse of `curvature` (P, P) over the free parameters, 0 elsewhere and for a parameter without any effect.

    Parameters that cannot be distinguished have a very large variance: rounding makes the curvature of such a direction
    0 or less, and its inverse is then that of LEAST_CURVATURE.
    """
    inverse = np.zeros_like(curvature)
    known = np.flatnonzero(free & (np.diag(curvature) > LEAST_EFFECT))
    inner = curvature[np.ix_(known, known)]
    scale = 1.0 / np.sqrt(np.diag(inner))
    both = np.outer(scale, scale)
    values, vectors = np.linalg.eigh(inner * both)
    inverse[np.ix_(known, known)] = (vectors / np.maximum(values, LEAST_CURVATURE)) @ vectors.T * both
    return inverse
