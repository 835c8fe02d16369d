"""Objectives: the least squares of one material, with one body colour or one per pixel, and its expected values.

Rows θ are those of `parameters`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from hagoromo.measurement.parameters import LOG_GAMMA, LOG_N1, STRENGTH, TAIL, channels_of, interface_colour, pack_theta
from hagoromo.measurement.photometric.reading import PixelBodies, reading
from hagoromo.measurement.robust_fit import Objective
from hagoromo.measurement.sight import Array, Sight
from hagoromo.reflectance.material.material_estimate import MaterialEstimate


@dataclass(frozen=True, eq=False)
class MaterialObjective(Objective):
    """The least squares of one material with one body colour, with the derivatives that its covariance needs."""

    def model(self, theta: Array) -> Array:
        """Expected values (N, C) at θ (P,)."""
        return expected(self.observations.sight, theta)

    def jacobian(self, theta: Array) -> Array:
        """Derivatives of the values by θ (N, C, P); parameters that are eliminated follow."""
        c, columns = self.observations.channels, np.zeros((*self.observations.values.shape, len(theta)))
        columns[..., :c] = self.observations.sight.body[:, :, None] * np.eye(c)
        for i, slope in self.interface(theta[None])[1]:
            columns[..., i] = slope[0]
        return columns

    def within(self, columns: Array) -> Array:
        """Directions (N, C, Q) in the space of the values, with eliminated parameters projected out."""
        return columns

    def own_leverage(self) -> Array:
        """(N, C) leverage of a value by the eliminated parameters."""
        return np.zeros_like(self.observations.values)


@dataclass(frozen=True, eq=False)
class AlbedoVariationObjective(MaterialObjective):
    """The least squares with a body colour per pixel and a shared interface; `weights` (N, C) are frozen.

    The body colours are eliminated (`PixelBodies`). In θ, α c_b is the mean over the pixels.
    """

    @cached_property
    def pixel(self) -> NDArray[np.intp]:
        """(N,) row of each sample's pixel, 0, 1, …"""
        return np.unique(self.observations.pixel, return_inverse=True)[1]

    @cached_property
    def power(self) -> Array:
        """(P, C) inverse variance of each pixel's body; 0 where a channel was not measured."""
        return self._bodies.power

    def bodies(self, theta: Array) -> Array:
        """Body colours α c_b (P, C) that fit best with the interface of θ (P,), NaN for channels not measured."""
        bodies = self._bodies.of(self.observations.values - self._interface(theta))
        return np.where(self.power > 0.0, bodies, np.nan)

    def evaluate(self, theta: Array) -> tuple[Array, Array, Array]:
        """Cost (K,), gradient (K, P) and Gauss–Newton curvature (K, P, P) at rows theta (K, P)."""
        rows = [self._at(row) for row in theta]
        cost, gradient, curvature = (np.stack(part) for part in zip(*rows, strict=True))
        return cost, gradient, curvature

    def model(self, theta: Array) -> Array:
        """Expected values (N, C) with the body colour of each pixel."""
        interface = self._interface(theta)
        return self._bodies.light(self.observations.values - interface) + interface

    def jacobian(self, theta: Array) -> Array:
        """Derivatives of the values by θ (N, C, P); the body colours follow."""
        columns = self._columns(theta)
        c = self.observations.channels
        share = (
            self._share
            * self.observations.sight.body
            * (self._bodies.variance / self._mean_variance / self._count)[self.pixel]
        )
        gloss = self.within(columns) + share[..., None] * self._mean(columns)
        return np.concatenate([share[..., None] * np.eye(c), gloss], axis=-1)

    def within(self, columns: Array) -> Array:
        """Columns (N, C, Q) less their projection on changes of the pixels' body colours."""
        return np.stack([one - self._bodies.light(one) for one in np.moveaxis(columns, 2, 0)], axis=-1)

    def own_leverage(self) -> Array:
        """(N, C) leverage of a value in the body colour of its pixel."""
        return self._bodies.leverage()

    @cached_property
    def _bodies(self) -> PixelBodies:
        assert self.weights is not None
        weight = np.where(self.observations.used, self.weights, 0.0) / self.variance
        return PixelBodies(self.pixel, self.observations.sight.body, weight)

    @cached_property
    def _share(self) -> Array:
        return (self.power > 0.0).astype(np.float64)[self.pixel]

    @cached_property
    def _count(self) -> Array:
        """(C,) number of pixels in which each channel was measured."""
        return np.maximum(np.sum(self.power > 0.0, axis=0), 1)

    @cached_property
    def _mean_variance(self) -> Array:
        """(C,) variance of the mean body at a given interface."""
        return self._bodies.variance.sum(axis=0) / self._count**2

    def _at(self, theta: Array) -> tuple[Array, Array, Array]:
        c = self.observations.channels
        columns = self._columns(theta)
        rest = self.observations.values - self._interface(theta)
        bodies = self._bodies.of(rest)
        deviation = rest - self.observations.sight.body * bodies[self.pixel]
        beside = (theta[:c] - bodies.sum(axis=0) / self._count) / self._mean_variance
        within, mean = self.within(columns), self._mean(columns)
        cost = 0.5 * np.sum(self._bodies.weight * deviation**2) + 0.5 * np.sum(beside**2 * self._mean_variance)
        gradient = np.r_[beside, beside @ mean - np.einsum("nc,ncq,nc->q", self._bodies.weight, within, deviation)]
        curvature = np.diag(np.r_[1.0 / self._mean_variance, np.zeros(columns.shape[2])])
        curvature[:c, c:] = mean / self._mean_variance[:, None]
        curvature[c:, :c] = curvature[:c, c:].T
        curvature[c:, c:] = (
            np.einsum("nc,ncp,ncq->pq", self._bodies.weight, within, within) + mean.T @ curvature[:c, c:]
        )
        return np.asarray(cost), gradient, curvature

    def _columns(self, theta: Array) -> Array:
        """(N, C, P − C) slopes of the interface by what follows the body in θ."""
        c = self.observations.channels
        columns = np.zeros((*self.observations.values.shape, len(theta) - c))
        for i, slope in self.interface(theta[None])[1]:
            columns[..., i - c] = slope[0]
        return columns

    def _interface(self, theta: Array) -> Array:
        """(N, C) values of the interface at θ (P,)."""
        return self.interface(theta[None])[0][0]

    def _mean(self, columns: Array) -> Array:
        """(C, P − C) change of the mean body per change along the columns."""
        means = [self._bodies.of(column).sum(axis=0) / self._count for column in np.moveaxis(columns, 2, 0)]
        return np.stack(means, axis=-1)


def theta_of(material: MaterialEstimate, alpha_body: Array) -> Array:
    """θ (P,) of an estimate, with the body α c_b `alpha_body` (C,)."""
    colour = np.array(material.interface_colour)
    return pack_theta(alpha_body, material.beta, material.gamma, material.n, material.nu, colour)


def interface_of(sight: Sight, material: MaterialEstimate) -> Array:
    """Values (N, C) of the interface of an estimate, all its lobes together."""
    none = np.zeros(len(material.body_colour))
    further = [replace(material, beta=beta, gamma=gamma, nu=np.inf) for beta, gamma in material.lobes]
    return np.sum([expected(sight, theta_of(lobe, none)) for lobe in (material, *further)], axis=0)


def expected(sight: Sight, theta: Array) -> Array:
    """Expected values (N, C) at θ (P,)."""
    lobe = sight.lobe(theta[LOG_GAMMA, None], theta[LOG_N1:], theta[TAIL, None]).value[0]
    return reading(theta[: channels_of(theta)], sight.body, theta[STRENGTH] * interface_colour(theta), lobe)
