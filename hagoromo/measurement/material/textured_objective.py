"""TexturedObjective: the least squares of a material whose body colour is each pixel's own, its interface shared.

For given β F₀, γ and n the body of a pixel has a closed form, so it is eliminated (variable projection, Golub & Pereyra
1973). The coordinates stay θ = (α c_b per channel, β F₀, ln γ, ln(n − 1)), α c_b now the mean over the pixels.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from hagoromo.measurement.material.material_objective import MaterialObjective
from hagoromo.measurement.sight import Array


@dataclass(frozen=True, eq=False)
class TexturedObjective(MaterialObjective):
    """As `MaterialObjective`, with `weights` (N, C) frozen and each pixel's own body beside θ."""

    @cached_property
    def pixel(self) -> NDArray[np.intp]:
        """(N,) row of each place's pixel, 0, 1, …"""
        return np.unique(self.seen.pixel, return_inverse=True)[1]

    @cached_property
    def power(self) -> Array:
        """(P, C) Σ w b² of each pixel: the inverse variance of its body; 0 where a channel was not seen."""
        return self._sum(self._weight * self.seen.sight.body**2)

    def bodies(self, theta: Array) -> Array:
        """Body colours α c_b (P, C) that go best with the interface of θ (P,), NaN where a channel was not seen."""
        bodies = self._body_of(self.seen.values - theta[-3] * self._interface(theta)[0])
        return np.where(self.power > 0.0, bodies, np.nan)

    def at(self, theta: Array) -> tuple[Array, Array, Array]:
        """Cost (K,), gradient (K, P) and Gauss–Newton curvature (K, P, P) at rows theta (K, P)."""
        found = [self._at(row) for row in theta]
        cost, gradient, curvature = (np.stack(part) for part in zip(*found, strict=True))
        return cost, gradient, curvature

    def model(self, theta: Array) -> Array:
        """Expected values (N, C): each pixel with its own body."""
        interface = theta[-3] * self._interface(theta)[0]
        return self.seen.sight.body * self._body_of(self.seen.values - interface)[self.pixel] + interface

    def jacobian(self, theta: Array) -> Array:
        """Derivatives of the values by θ (N, C, P), the bodies following."""
        columns = self._columns(theta)
        c = self.seen.channels
        share = self._share * self.seen.sight.body * (self._inverse / self._mean_variance / self._count)[self.pixel]
        gloss = self.within(columns) + share[..., None] * self._mean(columns)
        return np.concatenate([share[..., None] * np.eye(c), gloss], axis=-1)

    def within(self, columns: Array) -> Array:
        """Columns (N, C, Q) less what a change of the pixels' bodies does as well."""
        taken = np.stack([self._body_of(column) for column in np.moveaxis(columns, 2, 0)], axis=-1)
        return columns - self.seen.sight.body[..., None] * taken[self.pixel]

    def own_leverage(self) -> Array:
        """(N, C) share of a value in the body of its pixel."""
        return self._weight * self.seen.sight.body**2 * self._inverse[self.pixel]

    @cached_property
    def _weight(self) -> Array:
        assert self.weights is not None
        return np.where(self.seen.used, self.weights, 0.0) / self.variance

    @cached_property
    def _inverse(self) -> Array:
        return np.divide(1.0, self.power, out=np.zeros_like(self.power), where=self.power > 0.0)

    @cached_property
    def _share(self) -> Array:
        return (self.power > 0.0).astype(np.float64)[self.pixel]

    @cached_property
    def _count(self) -> Array:
        """(C,) pixels that each channel was seen in."""
        return np.maximum(np.sum(self.power > 0.0, axis=0), 1)

    @cached_property
    def _mean_variance(self) -> Array:
        """(C,) variance of the mean body at a given interface."""
        return self._inverse.sum(axis=0) / self._count**2

    def _at(self, theta: Array) -> tuple[Array, Array, Array]:
        c = self.seen.channels
        columns = self._columns(theta)
        rest = self.seen.values - theta[-3] * columns[..., 0]
        bodies = self._body_of(rest)
        deviation = rest - self.seen.sight.body * bodies[self.pixel]
        beside = (theta[:c] - bodies.sum(axis=0) / self._count) / self._mean_variance
        within, mean = self.within(columns), self._mean(columns)
        cost = 0.5 * np.sum(self._weight * deviation**2) + 0.5 * np.sum(beside**2 * self._mean_variance)
        gradient = np.r_[beside, beside @ mean - np.einsum("nc,ncq,nc->q", self._weight, within, deviation)]
        curvature = np.diag(np.r_[1.0 / self._mean_variance, np.zeros(3)])
        curvature[:c, c:] = mean / self._mean_variance[:, None]
        curvature[c:, :c] = curvature[:c, c:].T
        curvature[c:, c:] = np.einsum("nc,ncp,ncq->pq", self._weight, within, within) + mean.T @ curvature[:c, c:]
        return np.asarray(cost), gradient, curvature

    def _columns(self, theta: Array) -> Array:
        """(N, C, 3) slopes of the interface by β F₀, ln γ, ln(n − 1)."""
        value, by_gamma, by_n = self._interface(theta)
        return np.stack([value, theta[-3] * by_gamma, theta[-3] * by_n], axis=-1)

    def _interface(self, theta: Array) -> tuple[Array, Array, Array]:
        value, by_gamma, by_n = self.seen.sight.interface(theta[-2:-1], theta[-1:])
        return value[0], by_gamma[0], by_n[0]

    def _mean(self, columns: Array) -> Array:
        """(C, 3) how the mean body gives way to the columns."""
        given = [self._body_of(column).sum(axis=0) / self._count for column in np.moveaxis(columns, 2, 0)]
        return np.stack(given, axis=-1)

    def _body_of(self, values: Array) -> Array:
        """(P, C) least squares of values (N, C) by b in each pixel, 0 where a channel was not seen."""
        return self._sum(self._weight * self.seen.sight.body * values) * self._inverse

    def _sum(self, values: Array) -> Array:
        """(N, C) summed over the places of each pixel: (P, C)."""
        return np.stack([np.bincount(self.pixel, column).astype(np.float64) for column in values.T], axis=1)
