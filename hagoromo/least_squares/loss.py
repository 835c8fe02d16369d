"""Loss: how much a residual counts in a robust fit; constants and intervals of normal noise.

Log interval: bounds of a number above 0 whose logarithm has a normal error. No standard error makes them overflow.

A bound that no float holds is infinite, as the data then set none; an error that is not a number is an infinite one.
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

ROBUST_SCALE = 1.4826  # standard deviation of a normal error over its median absolute value (Hampel 1974)
NORMAL_95 = 1.959964  # 0.975 quantile of the standard normal distribution: half a 95 % interval
NORMAL_MEDIAN = 0.4549364  # median of r² for a standard normal r: χ² of one degree of freedom
CAUCHY_SCALE = 2.385  # standard deviations: 95 % efficient under normal noise (Holland & Welsch 1977)
HUBER_SCALE = 1.345  # 95 % efficient under normal noise (Huber 1981)
TUKEY_SCALE = 6.0  # 98 % efficient under normal noise, forgets what lies beyond 6σ (Mosteller & Tukey 1977)
LARGEST_LOGARITHM = math.log(sys.float_info.max)


@dataclass(frozen=True)
class Loss:
    """ρ(r) of a residual r in standard deviations: Huber's, Tukey's biweight or Cauchy's, with the scale k.

    Huber: r²/2 up to k, then k (|r| − k/2), convex. Tukey: k²/6 (1 − (1 − r²/k²)³), constant beyond k. Cauchy:
    k²/2 ln(1 + r²/k²). All are r²/2 near 0.
    """

    name: str
    scale: float

    def value(self, r: Array) -> Array:
        """ρ(r)."""
        k = self.scale
        if self.name == "tukey":
            return k**2 / 6 * (1.0 - np.maximum(1.0 - (r / k) ** 2, 0.0) ** 3)
        if self.name == "cauchy":
            return 0.5 * k**2 * np.log1p((r / k) ** 2)
        size = np.abs(r)
        return np.where(size <= k, 0.5 * r * r, k * (size - 0.5 * k))

    def weight(self, r: Array) -> Array:
        """ρ'(r)/r."""
        k = self.scale
        if self.name == "tukey":
            return np.maximum(1.0 - (r / k) ** 2, 0.0) ** 2
        if self.name == "cauchy":
            return 1.0 / (1.0 + (r / k) ** 2)
        return k / np.maximum(np.abs(r), k)

    def curvature(self, r: Array) -> Array:
        """ρ''(r)."""
        k = self.scale
        if self.name == "huber":
            return (np.abs(r) <= k).astype(np.float64)
        t = (r / k) ** 2
        if self.name == "tukey":
            return np.where(t < 1.0, (1.0 - t) * (1.0 - 5.0 * t), 0.0)
        return (1.0 - t) / (1.0 + t) ** 2


HUBER, TUKEY, CAUCHY = Loss("huber", HUBER_SCALE), Loss("tukey", TUKEY_SCALE), Loss("cauchy", CAUCHY_SCALE)


def robust_scale(residuals: NDArray[Any]) -> float:
    """Standard deviation of normal `residuals` about 0, by their median absolute value: 1.4826 median |r|."""
    return float(ROBUST_SCALE * np.median(np.abs(residuals)))


def exp_or_infinity(logarithm: float) -> float:
    """e to this power; infinity where no float holds it."""
    return math.exp(logarithm) if logarithm < LARGEST_LOGARITHM else math.inf


def log_interval(value: float, relative: float, reach: float = NORMAL_95) -> tuple[float, float]:
    """value · exp(± reach · relative): the bounds of a number, 0 or more, with this standard error of its logarithm."""
    if not value > 0.0:
        return 0.0, 0.0
    middle, half = math.log(value), reach * relative if math.isfinite(relative) else math.inf
    return exp_or_infinity(middle - half), exp_or_infinity(middle + half)
