"""Forecast: how far off a photograph under a further lamp will be, by the photographs that were left out.

    e² = a² + (b d)² + δ²

d is the angle from the lamp to the hull of the lamps measured (to the cone of their sums), 0 inside. Each photograph
left out has its lamp at some d from the others: a and b follow from their errors, so that outer lamps say how errors
grow. δ is what a photograph is off by for a lamp that is not as stated: any of those of the lamps measured. All of it
is for the median, as a single lamp that is far off, or one highlight that was missed, would say little of others.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

Array = NDArray[np.float64]
GROWTHS = np.concatenate([[0.0], np.geomspace(0.1, 100.0, 121)])  # candidates of b/a [1/rad]
LEAST = 1e-12  # relative error: of photographs without noise


@dataclass(frozen=True)
class Forecast:
    """Relative error `inside` a of lamps in the hull of those measured, and its `growth` b [1/rad] outside: medians."""

    inside: float
    growth: float

    def error(self, outside: float) -> float:
        """Of a photograph whose lamp is known and is `outside` [rad] the hull."""
        return math.hypot(self.inside, self.growth * outside)

    def expected(self, outside: float, departures: Sequence[float]) -> float:
        """Of a photograph under a lamp as stated, `outside` [rad] the hull: half of such photographs are nearer.

        departures: relative errors of the photographs measured by their lamps, had these been taken as stated.
        """
        return float(np.median(np.hypot(self.error(outside), np.asarray(departures, np.float64))))


def outside_hull(lamps: Array, to_lamp: Array) -> float:
    """Angle [rad] from the direction `to_lamp` (3,) to the hull of directions `lamps` (K, 3); 0 inside."""
    towards = to_lamp / np.linalg.norm(to_lamp)
    return float(math.asin(min(nnls(lamps.T, towards)[1], 1.0)))


def forecast_of(outside: Sequence[float], errors: Sequence[float]) -> Forecast:
    """The forecast by relative `errors` of photographs whose lamps are `outside` [rad] the hull of the others.

    a and b leave the least sum of |ln found/expected|.
    """
    found = np.log(np.maximum(np.asarray(errors, np.float64), LEAST))
    grown = 0.5 * np.log1p((GROWTHS[:, None] * np.asarray(outside, np.float64)) ** 2)
    inside = np.median(found - grown, axis=1)
    best = int(np.argmin(np.abs(found - grown - inside[:, None]).sum(axis=1)))
    a = math.exp(inside[best])
    return Forecast(a, float(GROWTHS[best]) * a)
