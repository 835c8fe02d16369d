"""The most likely curve R = s κ log(1 + exp(z/κ)) for one prior with known parameters, and its evidence.

Laplace's approximation: Rasmussen and Williams 2006, "Gaussian Processes for Machine Learning", §3.4.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.calibration.response.curve_prior import CurvePrior
from hagoromo.calibration.response.curve_process import positive, slope
from hagoromo.calibration.response.reading_equations import Normal, ReadingEquations, ReadingNoise

CURVE_STEPS = 200  # most Gauss–Newton steps to the mode of one curve
CURVE_DECREASE = 1e-6
Array = NDArray[np.float64]


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
