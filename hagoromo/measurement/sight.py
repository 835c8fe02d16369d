"""Sight: the geometry of lamps, eye and surface at points of known shape, and the irradiance there.

Enters: points [m], normals (unit, world), the lamps and the camera of a photograph. Leaves: the value per unit of
α c_b and of β F₀ at each point, for any γ and n, with its derivatives; F₀ = F(0, n) = ((n − 1)/(n + 1))².
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import arrays
from hagoromo.camera.response import camera_white
from hagoromo.light.lamp import Lamp
from hagoromo.photograph.photograph import Photograph
from hagoromo.reflectance.torrance_sparrow import Cosines, fresnel, weights_at

Array = NDArray[np.float64]

GRAZING_COSINE = 0.17  # cos 80°: there an error of 1° in the normal changes the cosine, and so the value, by 10 %
NO_LAMP = Cosines(-1.0, -1.0, 1.0, 1.0)  # fills the place of an absent lamp: its irradiance is 0


@dataclass(frozen=True, eq=False)
class Sight:
    """N points, each lit by up to L lamps, measured in C channels.

    cosines: four (N, L), see `Cosines`. irradiance: (N, L, C) on a plane that faces the lamp, times its white; 0 where
    there is no lamp.
    """

    cosines: Cosines
    irradiance: Array

    @property
    def body(self) -> Array:
        """Value per unit of α c_b: (N, C), Σ over the lamps of E cosθ_i, 0 where the surface faces away."""
        facing = (self.cosines.incidence > 0.0) & (self.cosines.view > 0.0)
        return np.einsum("nlc,nl->nc", self.irradiance, np.where(facing, self.cosines.incidence, 0.0))

    def interface(self, log_gamma: Array, log_n1: Array) -> tuple[Array, Array, Array]:
        """Value per unit of β F₀ at K pairs (ln γ, ln(n − 1)), and its derivatives by the two: three (K, N, C).

        Forward-mode derivatives of the package's one implementation of eq. (3), in double precision.
        """
        k, shape = len(log_gamma), self.cosines.half.shape
        real: Any = arrays().Float64
        cosines = Cosines(*(dr.tile(real(cosine.ravel()), k) for cosine in self.cosines))
        rows = [dr.repeat(real(row), shape[0] * shape[1]) for row in (log_gamma, log_n1)]
        parts = []
        for row in rows:
            dr.enable_grad(row)
            dr.set_grad(row, 1.0)
            n = 1.0 + dr.exp(rows[1])
            value = weights_at(cosines, 0.0, 1.0 / fresnel(1.0, n), dr.exp(rows[0]), n).interface
            slope = dr.forward_to(value)
            parts = parts or [dr.detach(value)]
            parts.append(slope)
            dr.disable_grad(row)
        dr.eval(parts)
        s, by_gamma, by_n = (self._sum_of_lamps(np.asarray(part).reshape(k, *shape)) for part in parts)
        return s, by_gamma, by_n

    def _sum_of_lamps(self, weights: Array) -> Array:
        """(K, N, L) → (K, N, C)."""
        if weights.shape[2] == 1:
            return weights * self.irradiance[None, :, 0]
        return np.einsum("knl,nlc->knc", weights, self.irradiance)

    @property
    def fit_to_use(self) -> NDArray[np.bool_]:
        """(N,) viewed and lit above the grazing limit, and no lamp closer to the terminator than that limit."""
        incidence = self.cosines.incidence
        lit = (incidence > GRAZING_COSINE).any(axis=1) & ~(
            (incidence > -GRAZING_COSINE) & (incidence <= GRAZING_COSINE)
        ).any(axis=1)
        return lit & (self.cosines.view[:, 0] > GRAZING_COSINE)

    @property
    def least_half_angle(self) -> Array:
        """(N,) smallest φ [rad] over the lamps that light the point, π where none does."""
        angle = np.arccos(np.clip(self.cosines.half, -1.0, 1.0))
        return np.where(self.cosines.incidence > 0, angle, np.pi).min(axis=1)


def sight_of(photograph: Photograph, points: Array, normals: Array, lamp_colour: Array | None = None) -> Sight:
    """Geometry of `photograph` at points (N, 3) [m] with unit normals (N, 3).

    lamp_colour: (C,) white of every lamp; if absent, ∫E R dλ of the lamp's spectrum, or 1 without a camera response.
    """
    to_eye = _unit(photograph.camera.position - points)
    view = np.einsum("ni,ni->n", normals, to_eye)
    columns, irradiances = [], []
    for lamp in photograph.lamps:
        to_lamp, irradiance = lamp.direction_and_irradiance(points)
        incidence = np.einsum("ni,ni->n", normals, to_lamp)
        # V·Q = √((1 + L·V)/2), N·Q = (N·L + N·V) / (2 V·Q)
        deviation = np.sqrt(np.maximum(0.5 + 0.5 * np.einsum("ni,ni->n", to_lamp, to_eye), 1e-12))
        columns.append((incidence, view, np.clip(0.5 * (incidence + view) / deviation, -1.0, 1.0), deviation))
        scale = _white(photograph, lamp) if lamp_colour is None else lamp_colour
        irradiances.append((irradiance if irradiance.ndim == 2 else irradiance[:, None]) * scale)
    cosines = Cosines(*(np.stack(column, axis=1) for column in zip(*columns, strict=True)))
    return Sight(cosines, np.stack(irradiances, axis=1))


def _white(photograph: Photograph, lamp: Lamp) -> Array:
    response = photograph.camera.response
    return np.ones(photograph.values.shape[2]) if response is None else camera_white(lamp.spectrum, response)


def _unit(vectors: Array) -> Array:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
