"""Curve prior: what is expected of a camera's curve R(λ) before it is measured: smooth, or like published cameras.

R = s κ log(1 + exp(z/κ)), and z is a Gaussian process; a prior gives its mean, its covariance and s for the parameters
that a fit searches, and what is expected of these.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hagoromo.calibration.response.curve_process import JITTER, matern, published_process
from hagoromo.calibration.response.published_curves import COMPONENTS, MEANS

# Chosen on the 28 measured cameras of camspec; it serves rawtoaces' 11 cameras as well.
ROUGHNESS = 0.1  # independent standard deviation of z per wavelength: measured curves are not smoother
# Wide log-normal priors (median, standard deviation of the logarithm) of the standard deviation of z and of its
# correlation length [nm], for data that do not determine them.
DEVIATION, LENGTH = (1.0, 0.7), (50.0, 0.7)
MIDDLE = (0.0, 1.0)  # prior of the mean of the process: mean and standard deviation
SCALE, AMPLITUDE = (1.0, 0.3), (1.0, 0.3)  # of the curve, and of its difference to the mean of published curves
Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class CurvePrior:
    """name: "smooth" or "published". middles, widths: expected parameters, and how much they may differ."""

    name: str
    middles: Array
    widths: Array
    mean: Array | None = None
    kernel: Array | None = None
    typical_length: float = 0.0

    def of(self, parameters: Array, wavelengths: Array) -> tuple[Array, Array, float]:
        """Mean (n,) and covariance (n, n) of z, and the scale s of R.

        parameters: smooth: ln standard deviation, ln correlation length [nm], mean; published: ln s, ln amplitude.
        """
        if self.mean is not None and self.kernel is not None:
            return self.mean, np.exp(2.0 * parameters[1]) * self.kernel, float(np.exp(parameters[0]))
        deviation, length = np.exp(parameters[:2])
        kernel = deviation**2 * matern(wavelengths, length)
        kernel += (ROUGHNESS**2 + JITTER * deviation**2) * np.eye(len(wavelengths))
        return np.full(len(wavelengths), parameters[2]), kernel, 1.0

    def start(self, wavelengths: Array) -> Array:
        """z (n,) from which a fit starts."""
        return np.full(len(wavelengths), 0.5) if self.mean is None else self.mean

    def length(self, parameters: Array) -> float:
        """Correlation length [nm]."""
        return self.typical_length or float(np.exp(parameters[1]))


def priors_of(channel: str, wavelengths: Array) -> list[CurvePrior]:
    """The priors of a channel: smooth, and for R, G and B like published cameras."""
    smooth = CurvePrior(
        "smooth", np.array([*np.log([DEVIATION[0], LENGTH[0]]), MIDDLE[0]]),
        np.array([DEVIATION[1], LENGTH[1], MIDDLE[1]]),
    )  # fmt: skip
    if channel not in MEANS:
        return [smooth]
    mean, kernel = published_process(
        wavelengths, np.array(MEANS[channel].mean), np.array(COMPONENTS[channel]), MEANS[channel]
    )
    published = CurvePrior(
        "published", np.log([SCALE[0], AMPLITUDE[0]]), np.array([SCALE[1], AMPLITUDE[1]]), mean, kernel,
        MEANS[channel].length,
    )  # fmt: skip
    return [published, smooth]
