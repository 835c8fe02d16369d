"""Sight: the geometry of lamps, eye and surface at points of known shape, and the irradiance there.

Enters: points [m], normals (unit, world), the lamps and the camera of a photograph. Leaves: the value per unit of
α c_b and of β F₀ at each point, for any γ, ν and n, with its derivatives; F₀ = F(0, n) = ((n − 1)/(n + 1))².
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import arrays
from hagoromo.camera.camera import Camera
from hagoromo.camera.response import white_of
from hagoromo.light.lamp import Lamp
from hagoromo.measurement.facets import facet_density
from hagoromo.photograph.photograph import Photograph
from hagoromo.reflectance.body import is_number
from hagoromo.reflectance.parameters import BodyLaw
from hagoromo.reflectance.torrance_sparrow import Cosines, fresnel, weights_at

Array = NDArray[np.float64]

GRAZING_COSINE = 0.17  # cos 80°: there an error of 1° in the normal changes the cosine, and so the value, by 10 %
FLAT_GAMMA = 1e6  # [rad] at which every facet density is 1
MOST_KEPT = 1 << 20  # numbers, of values that are kept for a next call with the same n
NO_LAMP = Cosines(-1.0, -1.0, 1.0, 1.0)  # fills the place of an absent lamp: its irradiance is 0


class LobeSlopes(NamedTuple):
    """The interface per unit of β F₀ and its derivatives by ln γ, ln(n − 1) and the tail 1/ν: each (K, N, C)."""

    value: Array
    by_log_gamma: Array
    by_log_n1: Array
    by_tail: Array


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
        return self.body_of(BodyLaw())

    def body_of(self, law: BodyLaw) -> Array:
        """As `body`, for a body after another law than Lambert's."""
        facing = (self.cosines.incidence > 0.0) & (self.cosines.view > 0.0)
        weight = np.where(facing, self.cosines.incidence, 0.0)
        if (factor := self._body_factor(law)) is not None:
            weight = weight * factor
        return np.einsum("nlc,nl->nc", self.irradiance, weight)

    def _body_factor(self, law: BodyLaw) -> Array | None:
        """(N, L); None where it is 1 everywhere."""
        real: Any = arrays().Float64
        incidence, view, _, deviation = (real(np.ascontiguousarray(part.ravel())) for part in self.cosines)
        phase = 2.0 * deviation * deviation - 1.0  # L·V
        opaque = {key: dr.opaque(real, value) for key, value in law.body_departures.items()}  # literals compile anew
        factor = BodyLaw(**opaque).body_factor(incidence, view, phase)
        return None if is_number(factor, 1.0) else np.array(factor).reshape(self.cosines.view.shape)

    def interface(self, log_gamma: Array, log_n1: Array, tail: Array | None = None) -> tuple[Array, Array, Array]:
        """Value per unit of β F₀ at K rows (ln γ, ln(n − 1), 1/ν), and its derivatives by the first two: (K, N, C).

        tail: 1/ν; None: 0, Gaussian facets.
        """
        lobe = self.lobe(log_gamma, log_n1, np.zeros(len(log_gamma)) if tail is None else tail)
        return lobe.value, lobe.by_log_gamma, lobe.by_log_n1

    def lobe(self, log_gamma: Array, log_n1: Array, tail: Array, with_tail: bool = False) -> LobeSlopes:
        """Value per unit of β F₀ at K rows (ln γ, ln(n − 1), 1/ν), and its derivatives: each (K, N, C).

        All but the facet density are the package's one implementation of eq. (3), in double precision, with its
        forward-mode derivative. with_tail: whether the derivative by 1/ν is needed; else it is 0.
        """
        different, row = np.unique(log_n1, return_inverse=True)
        flat, by_n = (part[row] for part in self._flat(different))
        width, beyond = (np.asarray(row, np.float64)[:, None, None] for row in (log_gamma, tail))
        density = facet_density(self._angle2, width, beyond, with_tail)
        parts = (flat * density.value, flat * density.by_log_gamma, by_n * density.value)
        by_tail = self._sum_of_lamps(flat * density.by_tail) if with_tail else np.zeros(1)
        value, by_gamma, by_index = (self._sum_of_lamps(part) for part in parts)
        return LobeSlopes(value, by_gamma, by_index, by_tail)

    @cached_property
    def _angle2(self) -> Array:
        """(N, L) φ² [rad²]."""
        return np.arccos(np.clip(self.cosines.half, -1.0, 1.0)) ** 2

    @cached_property
    def _last_flat(self) -> dict[bytes, tuple[Array, Array]]:
        """What `_flat` gave last, by its argument: steps of a fit that leave n where it is ask for it again."""
        return {}

    def _flat(self, log_n1: Array) -> tuple[Array, Array]:
        """F G / cosθ_r over F₀ at K values of ln(n − 1), and its derivative by it: two (K, N, L), 0 where unlit."""
        if (known := self._last_flat.get(log_n1.tobytes())) is not None:
            return known
        k, shape = len(log_n1), self.cosines.half.shape
        real: Any = arrays().Float64
        cosines = Cosines(*(dr.tile(real(cosine.ravel()), k) for cosine in self.cosines))
        log_index = dr.repeat(real(log_n1), shape[0] * shape[1])
        dr.enable_grad(log_index)
        dr.set_grad(log_index, 1.0)
        n = 1.0 + dr.exp(log_index)
        value = weights_at(cosines, 0.0, 1.0 / fresnel(1.0, n), FLAT_GAMMA, n).interface
        slope = dr.forward_to(value)
        parts = [dr.detach(value), slope]
        dr.eval(parts)
        flat, by_n = (np.array(part).reshape(k, *shape) for part in parts)
        self._last_flat.clear()
        if flat.size <= MOST_KEPT:
            self._last_flat[log_n1.tobytes()] = flat, by_n
        return flat, by_n

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
        to_lamp, irradiance = light_of(lamp, photograph.camera, photograph.values.shape[2], points, lamp_colour)
        incidence = np.einsum("ni,ni->n", normals, to_lamp)
        # V·Q = √((1 + L·V)/2), N·Q = (N·L + N·V) / (2 V·Q)
        deviation = np.sqrt(np.maximum(0.5 + 0.5 * np.einsum("ni,ni->n", to_lamp, to_eye), 1e-12))
        columns.append((incidence, view, np.clip(0.5 * (incidence + view) / deviation, -1.0, 1.0), deviation))
        irradiances.append(irradiance)
    cosines = Cosines(*(np.stack(column, axis=1) for column in zip(*columns, strict=True)))
    return Sight(cosines, np.stack(irradiances, axis=1))


def light_of(
    lamp: Lamp, camera: Camera, channels: int, points: Array, colour: Array | None = None
) -> tuple[Array, Array]:
    """Directions to the lamp (N, 3) from points (N, 3) [m], and its irradiance there (N, C) as the camera reads it.

    colour: (C,) white of the lamp; if absent, that of its spectrum.
    """
    to_lamp, irradiance = lamp.direction_and_irradiance(points)
    white = white_of(lamp.spectrum, camera.response, channels) if colour is None else colour
    return to_lamp, (irradiance if irradiance.ndim == 2 else irradiance[:, None]) * white


def _unit(vectors: Array) -> Array:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
