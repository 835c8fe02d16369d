"""The transfer of readings: they follow light to a power γ, and are off by b in the dark, ρ' = ρ^γ + b.

It is fitted with the curve, whose uncertainty is in that of γ and b. Units: the mean reading.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.calibration.response.curve_evidence import Found, best_prior, laplace
from hagoromo.calibration.response.reading_equations import ReadingEquations

TRANSFER_PRIOR = (0.5, 0.2)  # standard deviations of the power (around 1) and of the offset [mean reading]
TRANSFER_STEPS = 6
TRANSFER_FITS = 2  # of the curve and its noise, to readings made linear
LEAST_POWER, LEAST_OFFSET = 0.03, 0.005  # smaller ones are neither reported nor corrected
CERTAIN_TRANSFER = 5.0  # standard errors of a power or offset that is reported
Array = NDArray[np.float64]


class ReadingTransfer(NamedTuple):
    """Readings are ρ^power + offset, in units of their mean; covariance (2, 2); effect (n, 2) of both on the curve.

    stated: whether the power is taken from other channels.
    """

    power: float
    offset: float
    covariance: NDArray[np.floating]
    effect: NDArray[np.floating]
    stated: bool = False

    @property
    def errors(self) -> tuple[float, float]:
        """Standard errors of power and offset."""
        return float(np.sqrt(self.covariance[0, 0])), float(np.sqrt(self.covariance[1, 1]))

    @property
    def bent(self) -> bool:
        """Whether the power differs from 1 by what matters, and certainly."""
        return abs(self.power - 1.0) > max(LEAST_POWER, CERTAIN_TRANSFER * self.errors[0])

    @property
    def shifted(self) -> bool:
        """Whether the offset differs from 0 by what matters, and certainly."""
        return abs(self.offset) > max(LEAST_OFFSET, CERTAIN_TRANSFER * self.errors[1])

    @property
    def matters(self) -> bool:
        """Whether power or offset is as large as what would matter."""
        return abs(self.power - 1.0) > LEAST_POWER or abs(self.offset) > LEAST_OFFSET

    @property
    def certain(self) -> bool:
        """Whether the readings are not proportional to light."""
        return self.stated or self.bent or self.shifted


def fit_transfer(
    equations: ReadingEquations, found: Found, power: float = 1.0, offset: float = 0.0
) -> ReadingTransfer | None:
    """Power and offset of the readings, from an earlier estimate; None where the fit does not converge.

    Gauss–Newton on both: readings are made linear by the last estimate and compared with the curve that fits them. A
    curve that could explain the readings as well makes both uncertain.
    """
    linear, z = equations.linearised(power, offset), found.prior.start(equations.wavelengths)
    covariance, effect = np.zeros((2, 2)), np.zeros((len(z), 2))
    for _ in range(TRANSFER_STEPS):
        mode = laplace(linear, found.prior, found.parameters, found.noise, z)
        if mode is None:
            return None
        z, inverse = mode.z, linear.inverse(found.noise)
        expected = np.maximum(linear.matrix @ mode.curve, 1e-6)
        causes = np.stack([expected * np.log(expected), np.ones_like(expected)], axis=1)
        weighted = inverse.times(causes)
        across = (linear.matrix * mode.rate).T @ weighted
        towards = np.linalg.solve(mode.curvature, across)
        known_to = causes.T @ weighted - across.T @ towards + np.diag(np.array(TRANSFER_PRIOR) ** -2.0)
        covariance, effect = np.linalg.inv(known_to), -mode.rate[:, None] * towards
        away = np.array([power - 1.0, offset]) / np.array(TRANSFER_PRIOR) ** 2
        step = covariance @ (weighted.T @ (linear.readings - expected) - away)
        power, offset = float(np.clip(power * (1.0 + step[0]), 0.2, 5.0)), float(np.clip(offset + step[1], -0.5, 0.5))
        linear = equations.linearised(power, offset)
    return ReadingTransfer(power, offset, covariance, effect)


def linear_readings(
    equations: ReadingEquations, found: Found
) -> tuple[ReadingEquations, Found, ReadingTransfer | None]:
    """With readings made linear, if that is certain; else as they are. found: of the readings as they are.

    A wrong transfer looks like noise to the first fit, so its noise would hide the transfer: the fit of the linearised
    readings says how certain it is. The transfer is the best known one, also where the readings stay as they are.
    """
    first = transfer = fit_transfer(equations, found)
    again = found
    for _ in range(TRANSFER_FITS):
        if transfer is None or not transfer.matters:
            return equations, found, first
        again = best_prior(equations.linearised(transfer.power, transfer.offset), [found.prior])
        transfer = fit_transfer(equations, again, transfer.power, transfer.offset)
    if transfer is None or not transfer.certain:
        return equations, found, transfer or first
    return equations.linearised(transfer.power, transfer.offset), again, transfer
