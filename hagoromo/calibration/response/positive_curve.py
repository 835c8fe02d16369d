"""Positive curve: a smooth curve R(λ) > 0 from weighted integrals of it, with smoothness and noise from the data.

R = s κ log(1 + exp(z/κ)) with a Gaussian process z(λ), so R is positive, and linear in z where it is large. What is
expected of z is a prior (`curve_prior`): smooth and no more, or like the curves of published cameras. Its parameters,
the noise and what groups of readings share maximise the marginal likelihood (`curve_evidence`).

Errors that similar spectra share, where nobody states which do: seen by prediction of whole clusters of spectra.

With such errors, those of a lamp's spectrum for example, the evidence takes them for the camera, and the curve follows
them. The curve from some spectra then predicts others badly, and one with more noise than by evidence predicts better.
Where the lamps of the readings are known, `Groups` does better.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hagoromo.calibration.response.curve_evidence import (
    DIVERGED,
    Found,
    Mode,
    best_prior,
    laplace,
    most_evidence,
    typical_noise,
)
from hagoromo.calibration.response.curve_prior import CurvePrior, priors_of
from hagoromo.calibration.response.curve_process import positive
from hagoromo.calibration.response.reading_equations import LEAST_NOISE, Groups, ReadingEquations, ReadingNoise, Rows
from hagoromo.calibration.response.reading_transfer import ReadingTransfer, fit_transfer, linear_readings
from hagoromo.errors import InputError
from hagoromo.least_squares.fit_status import FitStatus

FEWEST_FOR_TRANSFER = 20  # readings
# Half a 95 % interval in standard deviations: 1.96 for a known prior, more as its parameters are fitted. Chosen by
# leaving out each of 28 cameras (`python -m studies response`).
HALF_INTERVAL = 2.2
Array = NDArray[np.float64]
CLUSTERS = 5  # of similar spectra; each is predicted from the others
FEWEST_CLUSTERED = 40  # least number of readings for that
FEWEST_CLUSTERS, FEWEST_OF_CLUSTER = 3, 5  # clusters, and readings of each
FAIR_MISFIT = 2.0  # mean square error of predictions, in units of typical noise, up to which the evidence is right
NOISE_FACTORS = (1.0, 1.6, 2.5, 4.0, 6.3, 10.0, 16.0, 25.0)  # on the noise, among which the prediction chooses
LARGE_NOISE = 1.5  # times the typical noise, from which readings may share errors
LARGE = 1e300  # misfit of a fit that does not converge


@dataclass(frozen=True, eq=False)
class PositiveCurve:
    """R > 0 and how well it is known.

    values: (n,). standard_error: (n,), to first order. interval_95: (n, 2). length: correlation length [nm]. noise:
    relative noise of a mean reading. status: how the search for length and noise ended. prior: name of the one that was
    taken. transfer: power and offset of the readings; None where there are too few. shared: relative standard deviation
    of what the readings of a group share, 0 without groups; gains: (groups, 2) that factor and its standard error.
    unit: of the curves that `transfer` has.
    """

    values: Array
    standard_error: Array
    interval_95: Array
    length: float
    noise: float
    status: FitStatus
    prior: str = ""
    transfer: ReadingTransfer | None = None
    shared: float = 0.0
    gains: Array | None = None
    unit: float = 1.0


def fit_positive_curve(
    wavelengths: Array,
    matrix: Array,
    readings: Array,
    priors: Sequence[CurvePrior] = (),
    rounding: float = 0.0,
    power: float | None = None,
    groups: Rows | None = None,
) -> PositiveCurve:
    """R > 0 at `wavelengths` (n,) [nm] from `readings` (m,) = matrix (m, n) R + noise; `readings` have a mean above 0.

    The variance of the noise is (relative · reading)² + floor² + rounding. power: of the readings over light, if other
    channels show one that this one leaves open. priors: among which the evidence chooses (default: smooth). groups:
    (m,) numbers of the groups whose readings may share a factor. Raises `InputError` if the fit does not converge.
    """
    equations = ReadingEquations.scaled(wavelengths, matrix, readings, rounding)
    priors = priors or priors_of("", wavelengths)
    if groups is not None:
        equations = _grouped(equations, priors[0], groups)
    if power is not None:
        found = best_prior(equations.linearised(power, 0.0), priors)
        transfer = fit_transfer(equations, found, power)
        if transfer is not None:
            linear = equations.linearised(transfer.power, transfer.offset)
            return _curve(linear, best_prior(linear, priors), transfer._replace(stated=True))
    best = best_prior(equations, priors)
    if len(readings) < FEWEST_FOR_TRANSFER:
        return _curve(equations, best, None)
    linear, found, transfer = linear_readings(equations, best)
    if equations.groups is None and not (transfer is not None and transfer.certain):
        found = best_predicting(linear, found, priors)
    return _curve(linear, found, transfer)


def typical_curve(wavelengths: Array, matrix: Array, readings: Array, prior: CurvePrior) -> Array:
    """R (n,) as `fit_positive_curve`, for typical noise and smoothness: a first look without a search."""
    equations = ReadingEquations.scaled(wavelengths, matrix, readings)
    return equations.unit * _typical(equations, prior).curve


def _typical(equations: ReadingEquations, prior: CurvePrior) -> Mode:
    mode = laplace(equations, prior, prior.middles, typical_noise(), prior.start(equations.wavelengths))
    if mode is None:
        raise InputError(DIVERGED)
    return mode


def _grouped(equations: ReadingEquations, prior: CurvePrior, groups: Rows) -> ReadingEquations:
    """With what groups share, where there are two groups or more and some have several readings.

    What a group shares is a share of the readings that a first curve expects: a share of the readings themselves would
    favour low curves (Peelle's puzzle).
    """
    _, labels = np.unique(groups, return_inverse=True)
    if not 2 <= labels.max() + 1 < len(labels):
        return equations
    return equations._replace(groups=Groups(labels, equations.matrix @ _typical(equations, prior).curve))


def _curve(equations: ReadingEquations, found: Found, transfer: ReadingTransfer | None) -> PositiveCurve:
    mode = found.mode(equations)
    rate, unit = mode.rate, equations.unit
    covariance: Array = np.linalg.inv(mode.curvature).astype(np.float64)
    variance = np.diag(covariance)
    if transfer is not None and transfer.certain:  # the curve is as uncertain as what the readings were corrected by
        variance = variance + np.einsum("ni,ij,nj->n", transfer.effect, transfer.covariance, transfer.effect) / rate**2
    deviation, values = np.sqrt(variance), mode.curve
    error = rate * deviation
    # R is convex in z: its tangent is a lower bound, which is 0 where R is not significantly above 0
    upper = mode.scale * positive(mode.z + HALF_INTERVAL * deviation)
    interval = np.stack([np.maximum(values - HALF_INTERVAL * error, 0.0), upper], axis=1)
    noise = float(np.sqrt(found.noise.relative**2 + found.noise.floor**2 + 2.0 * LEAST_NOISE**2))
    gains = None if equations.groups is None else _gains(equations, equations.groups, found, mode, covariance)
    return PositiveCurve(
        unit * values, unit * error, unit * interval, found.prior.length(found.parameters), noise, found.status,
        found.prior.name, transfer, 0.0 if gains is None else found.noise.shared, gains, unit,
    )  # fmt: skip


def _gains(equations: ReadingEquations, groups: Groups, found: Found, mode: Mode, covariance: Array) -> Array:
    """(groups, 2): 1 + g of each group, and its standard error with that of the curve."""
    labels, expected = groups
    weight = equations.inverse(found.noise._replace(shared=0.0)).weight
    member = np.eye(groups.count)[labels] * (weight * expected)[:, None]
    known = 1.0 / (np.bincount(labels, weight * expected**2) + found.noise.shared**-2.0)
    gain = known * (member.T @ (equations.readings - equations.matrix @ mode.curve))
    slope = known[:, None] * (member.T @ (equations.matrix * mode.rate))
    variance = known + np.einsum("gn,nk,gk->g", slope, covariance, slope)
    return np.stack([1.0 + gain, np.sqrt(variance)], axis=1)


def best_predicting(equations: ReadingEquations, best: Found, priors: Sequence[CurvePrior]) -> Found:
    """`best`, the fit by evidence; or, if that predicts clusters of spectra badly, the prior and noise that do better.

    Of the noises that predict as well as the best one, within a standard error, the largest is taken, as the errors are
    fewer than the readings. Hastie et al. 2009, §7.10 (the rule of one standard error).
    """
    count = len(equations.readings)
    clusters = _clusters(equations.matrix) if count >= FEWEST_CLUSTERED else []
    if (
        len(clusters) < FEWEST_CLUSTERS
        or np.exp(_log_misfits(equations, best, 1.0, clusters)).sum() < FAIR_MISFIT * count
    ):
        return best
    searched = [best if best.prior is prior else most_evidence(equations, prior) for prior in priors]
    candidates = [found for found in searched if found is not None]
    factors = NOISE_FACTORS if best.noise.relative > LARGE_NOISE * typical_noise().relative else NOISE_FACTORS[:1]
    scores = np.array([[_log_misfits(equations, one, factor, clusters) for factor in factors] for one in candidates])
    kind = int(np.argmin(scores.mean(axis=2).min(axis=1)))
    if not _certain(scores[0].min(axis=0) - scores[kind].min(axis=0)):
        kind = 0
    least = int(np.argmin(scores[kind].mean(axis=1)))
    as_well = [k for k in range(len(factors)) if not _certain(scores[kind, k] - scores[kind, least])]
    factor = factors[max(as_well)]
    if factor == 1.0:
        return candidates[kind]
    noise = ReadingNoise(*(factor * of for of in candidates[kind].noise))
    return most_evidence(equations, candidates[kind].prior, noise) or candidates[kind]


def _certain(gain: Array) -> bool:
    """Whether clusters gain in the mean by more than its standard error."""
    return bool(gain.sum() > np.sqrt(len(gain)) * gain.std(ddof=1))


def _log_misfits(equations: ReadingEquations, found: Found, factor: float, clusters: Sequence[Rows]) -> Array:
    """(clusters,): ln misfit of each cluster by the curve from the others, which have `factor` times the noise.

    The logarithm, so that a cluster that nothing predicts does not decide.
    """
    noise = ReadingNoise(*(factor * of for of in found.noise))
    misfits, start = np.full(len(clusters), np.log(LARGE)), found.prior.start(equations.wavelengths)
    for k, rows in enumerate(clusters):
        others = equations.where(np.setdiff1d(np.arange(len(equations.readings)), rows))
        mode = laplace(others, found.prior, found.parameters, noise, start)
        if mode is not None:
            own = equations.where(rows)
            misfits[k] = np.log(own.normal(own.inverse(typical_noise())).misfit(mode.curve))
            start = mode.z
    return misfits


def _clusters(matrix: Array) -> list[Rows]:
    """Rows of each cluster of similar spectra (k-means of the spectra, each of norm 1), those of few left out."""
    from scipy.cluster.vq import kmeans2

    shapes = matrix / np.maximum(np.linalg.norm(matrix, axis=1, keepdims=True), 1e-30)
    starts = [int(np.argmax(shapes @ shapes.mean(axis=0)))]
    for _ in range(CLUSTERS - 1):  # the spectrum that is furthest from all so far
        starts.append(int(np.argmin((shapes @ shapes[starts].T).max(axis=1))))
    labels = kmeans2(shapes, shapes[starts], minit="matrix", missing="warn")[1]
    rows = [np.flatnonzero(labels == k) for k in range(CLUSTERS)]
    return [of for of in rows if len(of) >= FEWEST_OF_CLUSTER]
