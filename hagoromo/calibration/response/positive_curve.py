"""Positive curve: a smooth curve R(λ) > 0 from weighted integrals of it, with smoothness and noise from the data.

R = κ log(1 + exp(z/κ)) with a Gaussian process z(λ), so R is positive, and linear in z where it is large. The mean,
standard deviation and correlation length of the process and the noise maximise the marginal likelihood (Laplace's
approximation). In the unit of R, R = 1 everywhere gives the mean reading.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.least_squares import FitStatus, scipy_status

# Wide log-normal priors (median, standard deviation of the logarithm) of the standard deviation of z, its correlation
# length [nm], the relative noise and its floor (in units of the mean reading), for data that do not determine them.
DEVIATION, LENGTH, NOISE, FLOOR = (1.0, 0.7), (50.0, 0.7), (0.01, 1.5), (0.002, 1.5)
MIDDLE = (0.0, 1.0)  # prior of the mean of the process: mean and standard deviation
# KNEE and ROUGHNESS were chosen on the 28 measured cameras of camspec; they serve rawtoaces' 11 cameras as well.
KNEE = 0.3  # κ: below it R is an exponential of z, above it R ≈ z
ROUGHNESS = 0.1  # independent standard deviation of z per wavelength: measured curves are not smoother
LEAST_NOISE = 1e-5  # least relative noise of a reading
JITTER = 1e-6  # relative addition to the diagonal that keeps the kernel invertible in double precision
CURVE_STEPS = 200  # most Gauss–Newton steps to the mode of one curve
EVIDENCE_STEPS = 600  # evaluations of the evidence, in the search for smoothness and noise
CURVE_DECREASE = 1e-6
Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PositiveCurve:
    """R > 0 and how well it is known.

    values: (n,). standard_error: (n,), to first order. interval_95: (n, 2). length: correlation length [nm]. noise:
    relative noise of a mean reading. status: how the search for length and noise ended.
    """

    values: Array
    standard_error: Array
    interval_95: Array
    length: float
    noise: float
    status: FitStatus


@dataclass(frozen=True, eq=False)
class _Problem:
    """readings (m,) = matrix (m, n) R, both scaled so that R = 1 gives readings of mean 1; apart: (n, n) [nm]."""

    matrix: Array
    readings: Array
    apart: Array


def fit_positive_curve(wavelengths: Array, matrix: Array, readings: Array) -> PositiveCurve:
    """R > 0 at `wavelengths` (n,) [nm] from `readings` (m,) = matrix (m, n) R + noise; `readings` have a mean above 0.

    The variance of the noise is (relative · reading)² + floor². Raises `InputError` if the fit does not converge.
    Rasmussen and Williams 2006, "Gaussian Processes for Machine Learning", §3.4 (Laplace) and §5.4 (evidence).
    """
    from scipy.optimize import minimize

    size, level = matrix.sum(axis=1).mean(), readings.mean()
    problem = _Problem(matrix / size, readings / level, np.abs(wavelengths[:, None] - wavelengths))
    middles = np.array([*np.log([DEVIATION[0], LENGTH[0], NOISE[0], FLOOR[0]]), MIDDLE[0]])
    widths = np.array([DEVIATION[1], LENGTH[1], NOISE[1], FLOOR[1], MIDDLE[1]])
    last = [np.full(len(wavelengths), 0.5)]  # each fit starts where the one before it ended

    def cost(parameters: Array) -> float:
        mode = _laplace(problem, parameters, last[0])
        if mode is None:
            return np.inf
        last[0] = mode[0]
        return mode[1] + 0.5 * float(np.sum(((parameters - middles) / widths) ** 2))

    simplex = np.vstack([middles, middles + 0.5 * np.diag(widths)])
    options = {"initial_simplex": simplex, "xatol": 0.02, "fatol": 0.01, "maxfev": EVIDENCE_STEPS}
    search = minimize(cost, middles, method="Nelder-Mead", options=options)
    parameters = search.x
    mode = _laplace(problem, parameters, last[0])
    if mode is None:
        raise InputError("the fit of the response does not converge: add spectra that differ more")
    z, _, covariance = mode
    deviation, unit = np.sqrt(np.diag(covariance)), level / size
    values, error = _positive(z), _slope(z) * deviation
    # R is convex in z: its tangent is a lower bound, which is 0 where R is not significantly above 0
    interval = np.stack([np.maximum(values - 1.96 * error, 0.0), _positive(z + 1.96 * deviation)], axis=1)
    noise = float(np.sqrt(np.sum(np.exp(2.0 * parameters[2:4])) + 2.0 * LEAST_NOISE**2))
    return PositiveCurve(
        unit * values, unit * error, unit * interval, float(np.exp(parameters[1])), noise, scipy_status(search)
    )


def _positive(z: Array) -> Array:
    return KNEE * np.logaddexp(0.0, z / KNEE)


def _slope(z: Array) -> Array:
    """dR/dz = 1/(1 + exp(−z/κ))."""
    return 0.5 + 0.5 * np.tanh(0.5 * z / KNEE)


def _laplace(problem: _Problem, parameters: Array, start: Array) -> tuple[Array, float, NDArray] | None:
    """Mode of z (n,), −log evidence and the covariance at the mode; None if the Newton steps do not converge."""
    deviation, length, relative, floor = np.exp(parameters[:4])
    apart = np.sqrt(3.0) * problem.apart / length
    kernel = deviation**2 * (1.0 + apart) * np.exp(-apart)  # Matérn 3/2
    kernel += (ROUGHNESS**2 + JITTER * deviation**2) * np.eye(len(apart))
    variance = (relative**2 + LEAST_NOISE**2) * problem.readings**2 + floor**2 + LEAST_NOISE**2
    try:
        z, cost, curvature = _mode(problem, variance, np.linalg.inv(kernel), parameters[4], start)
        covariance = np.linalg.inv(curvature)
    except (np.linalg.LinAlgError, FloatingPointError):
        return None
    logs = np.linalg.slogdet(kernel)[1] + np.linalg.slogdet(curvature)[1] + np.sum(np.log(variance))
    return z, cost + 0.5 * float(logs), covariance


def _mode(
    problem: _Problem, variance: Array, precision: Array, middle: float, start: Array
) -> tuple[Array, float, NDArray]:
    """Gauss–Newton with halved steps, from `start`: z (n,), its cost, the curvature of the cost there."""

    def cost_at(z: Array) -> float:
        off = problem.matrix @ _positive(z) - problem.readings
        return 0.5 * float(np.sum(off**2 / variance) + (z - middle) @ precision @ (z - middle))

    z, cost = start, cost_at(start)
    for _ in range(CURVE_STEPS):
        rate = problem.matrix * _slope(z)
        curvature = (rate.T / variance) @ rate + precision
        off = problem.matrix @ _positive(z) - problem.readings
        step = np.linalg.solve(curvature, rate.T @ (off / variance) + precision @ (z - middle))
        share = 1.0
        while not (lower := cost_at(z - share * step)) < cost and share > 1e-6:
            share /= 2.0
        if share <= 1e-6 or cost - lower < CURVE_DECREASE * (1.0 + abs(cost)):
            return z, cost, curvature
        z, cost = z - share * step, lower
    raise FloatingPointError
