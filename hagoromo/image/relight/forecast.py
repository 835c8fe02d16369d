"""Forecast: how far off a photograph under a further lamp will be, by the photographs that were left out.

    E² = N + (1 + h) (m² (1 + (b d²)²) + P² δ²),   e = E / P

E is the error and P the light that is shown (root mean squares, per unit of irradiance): where P is less, as under
grazing light, the same E is a larger relative error e. N is the noise of the photograph, by the light that is shown.

h = lᵀ (Σ l lᵀ)⁻¹ l is the leverage of the lamp's direction l among those measured: what is linear in the direction, as
Lambert's law is, a pixel's normal and body take up, and with it the errors of the photographs; so these grow by 1 + h.
d is the angle from the lamp to the hull of the lamps measured (to the cone of their sums), 0 inside: what the pixels
cannot take up is of second order, and grows with d². m and b follow from the photographs left out, each of which has
an h and a d of its own among the others.

δ is what a photograph is off by for a lamp that is not as stated: any of those of the lamps measured. All of it is for
the median, as a single lamp that is far off, or one highlight that was missed, would say little of others.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

Array = NDArray[np.float64]
GROWTHS = np.concatenate([[0.0], np.geomspace(0.1, 100.0, 121)])  # candidates of b [1/rad²]
LEAST = 1e-12  # error per irradiance: of photographs without noise
LEAST_MISFIT = 0.1  # of an error, where noise alone explains it
LEAST_LEFT = 1e-3  # 1 − H at least, H being a lamp's leverage on itself: where it alone determines a direction


@dataclass(frozen=True)
class ShownLight:
    """Means over pixels and channels of what is shown per unit of irradiance: of the values and of their squares."""

    mean: float
    square: float

    @classmethod
    def of(cls, values: NDArray[np.floating]) -> ShownLight:
        """Of values of any shape."""
        return cls(float(np.mean(values)), max(float(np.mean(np.square(values, dtype=np.float64))), LEAST**2))


@dataclass(frozen=True)
class Missed:
    """A photograph left out: the number of its lamp, and means of the squares of its error and of its noise."""

    number: int
    error: float
    noise: float


@dataclass(frozen=True, eq=False)
class Forecast:
    """Errors of photographs under further lamps: medians.

    lamps: (K, 3) directions of those measured. misfit: m. growth: b [1/rad²]. noise: variance of a value of 0, and its
    increase by the value; per unit of irradiance.
    """

    lamps: Array
    misfit: float
    growth: float
    noise: tuple[float, float] = (0.0, 0.0)

    def error(self, to_lamp: Array, shown: ShownLight) -> float:
        """Relative, of a photograph under a lamp in the direction `to_lamp` (3,) that is as stated."""
        inflated = (1.0 + leverage(self.lamps, to_lamp)) * _grown(self.growth, outside_hull(self.lamps, to_lamp))
        noise = max(self.noise[0] + self.noise[1] * shown.mean, 0.0)
        return math.sqrt((noise + self.misfit**2 * inflated) / shown.square)

    def expected(self, to_lamp: Array, shown: ShownLight, departures: Sequence[float]) -> float:
        """Relative, of a photograph whose lamp was stated: half of such photographs are nearer.

        departures: relative errors of the photographs measured by their lamps, had these been taken as stated.
        """
        off = math.sqrt(1.0 + leverage(self.lamps, to_lamp)) * np.asarray(departures, np.float64)
        return float(np.median(np.hypot(self.error(to_lamp, shown), off)))


def outside_hull(lamps: Array, to_lamp: Array) -> float:
    """Angle [rad] from the direction `to_lamp` (3,) to the hull of directions `lamps` (K, 3); 0 inside."""
    towards = to_lamp / np.linalg.norm(to_lamp)
    return float(math.asin(min(nnls(lamps.T, towards)[1], 1.0)))


def leverage(lamps: Array, to_lamp: Array) -> float:
    """h of the direction `to_lamp` (3,) among directions `lamps` (K, 3)."""
    towards = to_lamp / np.linalg.norm(to_lamp)
    return float(towards @ np.linalg.pinv(lamps.T @ lamps) @ towards)


def own_leverages(lamps: Array) -> Array:
    """(K,) H of each of the directions `lamps` (K, 3), unit, of sum 3."""
    return np.array([leverage(lamps, one) for one in lamps])


def forecast_of(lamps: Array, missed: Sequence[Missed], noise: tuple[float, float] = (0.0, 0.0)) -> Forecast:
    """The forecast by photographs `missed` under some of the `lamps` (K, 3); noise: see `Forecast`.

    m and b leave the least sum of |ln found/expected|.
    """
    own = own_leverages(lamps)[[one.number for one in missed]]
    among = own / np.maximum(1.0 - own, LEAST_LEFT)  # leverage among the other lamps
    others = (np.delete(lamps, one.number, axis=0) for one in missed)
    outside = np.array([outside_hull(rest, lamps[one.number]) for rest, one in zip(others, missed, strict=True)])
    misfit = [max(one.error - one.noise, LEAST_MISFIT**2 * one.error, LEAST**2) for one in missed]
    found = 0.5 * (np.log(misfit) - np.log1p(among))
    grown = 0.5 * np.log(_grown(GROWTHS[:, None], outside))
    inside = np.median(found - grown, axis=1)
    best = int(np.argmin(np.abs(found - grown - inside[:, None]).sum(axis=1)))
    return Forecast(lamps, math.exp(inside[best]), float(GROWTHS[best]), noise)


def _grown(growth: Array | float, outside: Array | float) -> Array:
    """1 + (b d²)²"""
    return np.asarray(1.0 + (growth * np.square(outside)) ** 2, np.float64)
