"""Forecast: how far off a photograph under a further lamp will be, by the photographs that were left out.

    e² = a² + (b d)²

d is the angle from the lamp to the hull of the lamps measured (to the cone of their sums), 0 inside. Each photograph
left out has its lamp at some d from the others: a and b follow from their errors, so that outer lamps say how errors
grow.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

Array = NDArray[np.float64]
ROUNDS = 5  # of weights, which follow from the errors that are expected: their scatter is in proportion


@dataclass(frozen=True)
class Forecast:
    """Relative error `inside` a of lamps in the hull of those measured, and its `growth` b [1/rad] outside."""

    inside: float
    growth: float

    def error(self, outside: float) -> float:
        """Of a photograph whose lamp is `outside` [rad] the hull."""
        return math.hypot(self.inside, self.growth * outside)


def outside_hull(lamps: Array, to_lamp: Array) -> float:
    """Angle [rad] from the direction `to_lamp` (3,) to the hull of directions `lamps` (K, 3); 0 inside."""
    towards = to_lamp / np.linalg.norm(to_lamp)
    return float(math.asin(min(nnls(lamps.T, towards)[1], 1.0)))


def forecast_of(outside: Sequence[float], errors: Sequence[float]) -> Forecast:
    """The forecast by relative `errors` of photographs whose lamps are `outside` [rad] the hull of the others."""
    squares = np.asarray(errors, np.float64) ** 2
    terms = np.stack([np.ones(len(squares)), np.asarray(outside, np.float64) ** 2], axis=1)
    expected, found = np.full(len(squares), max(float(squares.mean()), 1e-30)), np.zeros(2)
    for _ in range(ROUNDS):
        found = nnls(terms / expected[:, None], squares / expected)[0]
        expected = np.maximum(terms @ found, 1e-3 * expected.max())
    return Forecast(*np.sqrt(found).tolist())
