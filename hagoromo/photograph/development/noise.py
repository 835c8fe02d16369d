"""Noise of a sensor: the variance of a linear signal by its gain and its read noise, and where these are from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.least_squares.loss import log_interval

KNOWN_GAIN = 0.3  # relative error of the gain below which the frames are said to determine it


@dataclass(frozen=True)
class Noise:
    """gain [e⁻/DN] and read_noise [e⁻] with standard errors (0 if the user stated them); source: their origin."""

    gain: float
    read_noise: float
    gain_error: float = 0.0
    read_error: float = 0.0
    source: str = "stated"

    def __post_init__(self) -> None:
        """Check the figures once."""
        if not (np.isfinite(self.gain) and self.gain > 0.0 and np.isfinite(self.read_noise) and self.read_noise >= 0.0):
            raise InputError(
                f"gain {self.gain} e⁻/DN and read noise {self.read_noise} e⁻: the gain must be above 0, "
                "the read noise 0 or more"
            )

    @property
    def gain_interval(self) -> tuple[float, float]:
        """95 % interval of the gain [e⁻/DN]."""
        return log_interval(self.gain, self.gain_error / self.gain)

    @property
    def determined(self) -> bool:
        """Whether the gain was stated, or frames determine it."""
        return self.gain_error <= KNOWN_GAIN * self.gain

    def variance(self, signal: NDArray, rounding: NDArray | float) -> NDArray[np.float64]:
        """Variance [DN²] of a signal with expectation `signal` [DN]; one electron² is added, so that it is never 0."""
        return (np.maximum(signal, 0.0) + (1.0 + self.read_noise**2) / self.gain) / self.gain + rounding
