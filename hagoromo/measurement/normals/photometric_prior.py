"""Prior: what lamps and bodies are taken for before the photographs speak, and how far the photographs widen that."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hagoromo.least_squares import CAUCHY_SCALE
from hagoromo.measurement.normals.views import Array

WORTH = 6.0  # numbers that a stated scale counts for beside those of the lamps


@dataclass(frozen=True)
class Prior:
    """What lamps and bodies are taken for. The default: lamps of one kind, set up by hand and read off a ball.

    strength: scale of ln e (Cauchy: now and then one lamp is off). slope: standard deviation of a, per radius of the
    object. direction: of each component of a lamp's shift [rad]. roughness, exponent: of σ and ln ε of the bodies.
    distance: of the ln distance of a surface of unknown depth.
    """

    strength: float = 0.01
    slope: float = 0.03
    direction: float = 0.01
    roughness: float = 0.2
    exponent: float = 0.2
    distance: float = 0.05

    @property
    def gloss(self) -> Array:
        """(4, 2) mean and standard deviation of ln β, ln γ, σ, ln ε: any dielectric, as broad as measured ones are."""
        return np.array([[np.log(1.0), 2.0], [np.log(0.3), 1.0], [0.0, self.roughness], [0.0, self.exponent]])

    def loss(self, lamps: Array) -> float:
        """Twice the negative logarithm of the prior of `lamps` (K, 6): ln e, a, shift."""
        strength = CAUCHY_SCALE**2 * np.log1p((lamps[:, 0] / self.strength / CAUCHY_SCALE) ** 2)
        others = np.sum((lamps[:, 1:3] / self.slope) ** 2) + np.sum((lamps[:, 3:] / self.direction) ** 2)
        return float(np.sum(strength) + others)

    def precision(self, lamps: Array) -> Array:
        """(K, 6) curvature of the prior at `lamps`; Cauchy's as a weight."""
        found = np.empty(lamps.shape)
        found[:, 0] = 1.0 / (self.strength**2 + (lamps[:, 0] / CAUCHY_SCALE) ** 2)
        found[:, 1:3] = self.slope**-2.0
        found[:, 3:] = self.direction**-2.0
        return found

    def learnt(self, stated: Prior, lamps: Array, variance: Array) -> Prior:
        """The prior whose scales go with `lamps` (K, 6) of this posterior variance (expectation maximisation).

        stated: what the scales were said to be; it counts for WORTH more numbers.
        """
        weight = np.ones(lamps.shape)
        weight[:, 0] = 1.0 / (1.0 + (lamps[:, 0] / self.strength / CAUCHY_SCALE) ** 2)
        second = weight * (lamps**2 + variance)

        def scale(columns: slice, before: float) -> float:
            numbers = second[:, columns]
            return float(np.sqrt((numbers.sum() + WORTH * before**2) / (numbers.size + WORTH)))

        return replace(
            self,
            strength=scale(np.s_[:1], stated.strength),
            slope=scale(np.s_[1:3], stated.slope),
            direction=scale(np.s_[3:], stated.direction),
        )
