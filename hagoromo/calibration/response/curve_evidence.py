"""Smoothness, noise and prior of a curve, by evidence: Rasmussen and Williams 2006, §5.4.

Of each prior the parameters of the most evidence are searched, with those of the noise; of the priors the one of more
evidence is taken.

The most likely curve R = s κ log(1 + exp(z/κ)) for one prior with known parameters, and its evidence.

Laplace's approximation: Rasmussen and Williams 2006, "Gaussian Processes for Machine Learning", §3.4.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.calibration.response.curve_prior import CurvePrior
from hagoromo.calibration.response.curve_process import positive, slope
from hagoromo.calibration.response.reading_equations import Normal, ReadingEquations, ReadingNoise
from hagoromo.errors import InputError
from hagoromo.least_squares.fit_status import FitStatus, scipy_status

# Wide log-normal priors (median, standard deviation of the logarithm) of the relative noise, of its floor (in units of
# the mean reading) and of what groups share, for data that do not determine them.
NOISES = ((0.01, 1.5), (0.002, 1.5), (0.005, 1.5))
EVIDENCE_STEPS = 600  # evaluations of the evidence, in the search for smoothness and noise
DIVERGED = "the fit of the response does not converge: add spectra that differ more"
Array = NDArray[np.float64]
CURVE_STEPS = 200  # most Gauss–Newton steps to the mode of one curve
CURVE_DECREASE = 1e-6


class Found(NamedTuple):
    """A prior with the parameters of the most evidence and the noise. cost: −ln evidence."""

    prior: CurvePrior
    parameters: Array
    noise: ReadingNoise
    cost: float
    status: FitStatus

    def mode(self, equations: ReadingEquations, start: Array | None = None) -> Mode:
        """The most likely curve. Raises `InputError` if the fit does not converge."""
        z = self.prior.start(equations.wavelengths) if start is None else start
        mode = laplace(equations, self.prior, self.parameters, self.noise, z)
        if mode is None:
            raise InputError(DIVERGED)
        return mode


def typical_noise() -> ReadingNoise:
    """The noise that is expected before the readings are seen."""
    return ReadingNoise(NOISES[0][0], NOISES[1][0])


def best_prior(equations: ReadingEquations, priors: Sequence[CurvePrior]) -> Found:
    """The prior, its parameters and the noise of the most evidence. Raises `InputError` if no fit converges."""
    searched = [found for prior in priors if (found := most_evidence(equations, prior)) is not None]
    if not searched:
        raise InputError(DIVERGED)
    return min(searched, key=lambda found: found.cost)


def most_evidence(equations: ReadingEquations, prior: CurvePrior, noise: ReadingNoise | None = None) -> Found | None:
    """The parameters of `prior` and the noise of the most evidence; None if no fit converges.

    noise: if it is known, it is not searched.
    """
    from scipy.optimize import minimize

    medians, widths = np.array(NOISES[: equations.noises if noise is None else 0]).reshape(-1, 2).T
    middles, widths = np.concatenate([prior.middles, np.log(medians)]), np.concatenate([prior.widths, widths])
    count = len(prior.middles)
    last = [prior.start(equations.wavelengths)]  # each fit starts where the one before it ended

    def cost(parameters: Array) -> float:
        mode = laplace(
            equations, prior, parameters[:count], noise or ReadingNoise(*np.exp(parameters[count:])), last[0]
        )
        if mode is None:
            return np.inf
        last[0] = mode.z
        return mode.cost + 0.5 * float(np.sum(((parameters - middles) / widths) ** 2))

    simplex = np.vstack([middles, middles + 0.5 * np.diag(widths)])
    options = {"initial_simplex": simplex, "xatol": 0.03, "fatol": 0.02, "maxfev": EVIDENCE_STEPS}
    search = minimize(cost, middles, method="Nelder-Mead", options=options)
    if not np.isfinite(search.fun):
        return None
    noise = noise or ReadingNoise(*(float(of) for of in np.exp(search.x[count:])))
    return Found(prior, search.x[:count], noise, float(search.fun), scipy_status(search))


class Mode(NamedTuple):
    """z (n,) of least cost, that cost, its curvature (n, n), and the scale s of R."""

    z: Array
    cost: float
    curvature: Array
    scale: float

    @property
    def curve(self) -> Array:
        """R (n,)."""
        return self.scale * positive(self.z)

    @property
    def rate(self) -> Array:
        """dR/dz (n,)."""
        return self.scale * slope(self.z)


def laplace(
    equations: ReadingEquations, prior: CurvePrior, parameters: Array, noise: ReadingNoise, start: Array
) -> Mode | None:
    """The mode with −log evidence as its cost; None if the Newton steps do not converge.

    parameters: of the prior.
    """
    mean, kernel, scale = prior.of(parameters, equations.wavelengths)
    inverse = equations.inverse(noise)
    try:
        mode = _mode(equations.normal(inverse), mean, np.asarray(np.linalg.inv(kernel), np.float64), scale, start)
        logs = np.linalg.slogdet(kernel)[1] + np.linalg.slogdet(mode.curvature)[1] + inverse.log_determinant
    except (np.linalg.LinAlgError, FloatingPointError):
        return None
    return mode._replace(cost=mode.cost + 0.5 * float(logs))


def _mode(normal: Normal, mean: Array, precision: Array, scale: float, start: Array) -> Mode:
    """Gauss–Newton with halved steps, from `start`."""

    def cost_at(z: Array) -> float:
        return 0.5 * (normal.misfit(scale * positive(z)) + float((z - mean) @ precision @ (z - mean)))

    z, cost = start, cost_at(start)
    for _ in range(CURVE_STEPS):
        rate = scale * slope(z)
        curvature = rate[:, None] * normal.square * rate + precision
        gradient = rate * (normal.square @ (scale * positive(z)) - normal.linear) + precision @ (z - mean)
        step = np.linalg.solve(curvature, gradient)
        share = 1.0
        while not (lower := cost_at(z - share * step)) < cost and share > 1e-6:
            share /= 2.0
        if share <= 1e-6 or cost - lower < CURVE_DECREASE * (1.0 + abs(cost)):
            return Mode(z, cost, curvature, scale)
        z, cost = z - share * step, lower
    raise FloatingPointError
