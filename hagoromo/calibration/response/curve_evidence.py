"""Smoothness, noise and prior of a curve, by evidence: Rasmussen and Williams 2006, §5.4.

Of each prior the parameters of the most evidence are searched, with those of the noise; of the priors the one of more
evidence is taken.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.calibration.response.curve_mode import Mode, laplace
from hagoromo.calibration.response.curve_prior import CurvePrior
from hagoromo.calibration.response.reading_equations import ReadingEquations, ReadingNoise
from hagoromo.errors import InputError
from hagoromo.least_squares.fit_status import FitStatus, scipy_status

# Wide log-normal priors (median, standard deviation of the logarithm) of the relative noise, of its floor (in units of
# the mean reading) and of what groups share, for data that do not determine them.
NOISES = ((0.01, 1.5), (0.002, 1.5), (0.005, 1.5))
EVIDENCE_STEPS = 600  # evaluations of the evidence, in the search for smoothness and noise
DIVERGED = "the fit of the response does not converge: add spectra that differ more"
Array = NDArray[np.float64]


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
