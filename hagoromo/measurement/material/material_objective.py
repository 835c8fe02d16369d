"""MaterialObjective: the least squares of one material with one body colour, and the values that it expects."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hagoromo.measurement.robust_fit import Objective
from hagoromo.measurement.sight import Array, Sight


@dataclass(frozen=True, eq=False)
class MaterialObjective(Objective):
    """The least squares of one material with one body colour, and what its covariance needs."""

    def model(self, theta: Array) -> Array:
        """Expected values (N, C) at θ (P,)."""
        return expected(self.seen.sight, theta)

    def jacobian(self, theta: Array) -> Array:
        """Derivatives of the values by θ (N, C, P), what is fitted beside θ following."""
        return jacobian(self.seen.sight, theta)

    def within(self, columns: Array) -> Array:
        """Directions (N, C, Q) in the space of the values, less what is fitted beside θ takes up of them."""
        return columns

    def own_leverage(self) -> Array:
        """(N, C) share of a value in its own fit by what is fitted beside θ."""
        return np.zeros_like(self.seen.values)


def expected(seen: Sight, theta: Array) -> Array:
    """Expected values (N, C) at θ (P,)."""
    interface = seen.interface(theta[-2:-1], theta[-1:])[0][0]
    return theta[:-3] * seen.body + theta[-3] * interface


def jacobian(seen: Sight, theta: Array) -> Array:
    """Derivatives of the expected values by θ: (N, C, P)."""
    interface, by_gamma, by_n = (part[0] for part in seen.interface(theta[-2:-1], theta[-1:]))
    body = seen.body[:, :, None] * np.eye(len(theta) - 3)
    shared = np.stack([interface, theta[-3] * by_gamma, theta[-3] * by_n], axis=-1)
    return np.concatenate([body, shared], axis=-1)
