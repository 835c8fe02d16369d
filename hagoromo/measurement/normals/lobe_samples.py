"""Lobe samples: some pixels of a material under all lamps, from which the lobes of its interface are estimated.

Body colours are eliminated pixel by pixel. Light in excess of the model counts in full, as it is what is sought; light
that is missing counts little, as shadows do. A clipped value is a lower bound.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import arrays
from hagoromo.least_squares.loss import CAUCHY_SCALE
from hagoromo.measurement.normals.photometric_model import Fit
from hagoromo.measurement.normals.shading import N, shading
from hagoromo.measurement.normals.views import Array, Views
from hagoromo.measurement.photometric.reading import reading
from hagoromo.photograph.capture import Capture
from hagoromo.reflectance.torrance_sparrow import cosines, weights_at

RELATIVE_ERROR = 0.02  # of the model, in the weights
BODY_PASSES = 2  # of re-weighting
CLIPPED = 0.98  # of the largest valid value: masked values above are clipped
LEAST_BODY = 1e-4  # smallest body colour, of their mean


@dataclass(frozen=True, eq=False)
class Samples:
    """Some pixels under K lamps: values (K, C, P); trusted (K, P) whether they are valid; lower (K, C, P) whether they
    are clipped, and so lower bounds; body, first: (K, P) what a body of 1 and the first lobe give; by_law (K, 2, P):
    slopes of that body by σ and ln(1 + ε); flat: the interface for D = β = 1; angle2: φ² [rad²]; colour (C, P) of the
    interface; sensor (K, C, P): variance of its noise; noise: the same with what errors of the normals make.
    """

    values: Array
    trusted: NDArray[np.bool_]
    lower: NDArray[np.bool_]
    body: Array
    first: Array
    by_law: Array
    flat: Array
    angle2: Array
    colour: Array
    sensor: Array
    noise: Array

    def lamps(self, chosen: NDArray) -> Samples:
        """The samples of some lamps."""
        parts = {key: value[chosen] for key, value in vars(self).items() if key != "colour"}
        return replace(self, **parts)

    def under_law(self, change: Array) -> Samples:
        """The samples with bodies whose (σ, ln(1 + ε)) differ by `change` (2,), to first order."""
        return replace(self, body=np.maximum(self.body + np.einsum("i,kip->kp", change, self.by_law), 0.0))

    def column(self, width: float) -> Array:
        """(K, P) a Gaussian lobe of β = 1 and this half width [rad]."""
        return self.flat * np.exp2(-self.angle2 / width**2)

    def interface(self, weights: Array, widths: Array) -> Array:
        """(K, P) the first lobe times weights[0], and lobes of `widths` with β weights[1:]."""
        total = weights[0] * self.first
        for weight, width in zip(weights[1:], widths, strict=True):
            if weight > 0.0:
                total = total + weight * self.column(float(width))
        return total

    def model(self, interface: Array, body: Array) -> Array:
        """(K, C, P) values of body colours (C, P) and the interface (K, P)."""
        return reading(body, self.body[:, None], self.colour, interface[:, None])

    def weights(self, model: Array | None) -> Array:
        """(K, C, P) inverse variance; less where light is missing; 0 where a lower bound holds already."""
        level = np.maximum(self.values, self.values.mean(axis=0))
        weight = 1.0 / (self.noise + (RELATIVE_ERROR * level) ** 2)
        weight = np.where(self.trusted[:, None] | self.lower, weight, 0.0)
        if model is None:
            return weight
        missing = np.maximum(model - self.values, 0.0)
        weight = weight / (1.0 + missing**2 * weight / CAUCHY_SCALE**2)
        return np.where(self.lower & (model >= self.values), 0.0, weight)

    def loss(self, model: Array) -> float:
        """That whose weights are `weights`: squares of light in excess, Cauchy's loss of light that is missing."""
        weight, left = self.weights(None), self.values - model
        squared = weight * left**2
        missing = CAUCHY_SCALE**2 * np.log1p(squared / CAUCHY_SCALE**2)
        return float(np.sum(np.where(left < 0.0, np.where(self.lower, 0.0, missing), squared)))

    def bodies(self, interface: Array) -> Array:
        """(C, P) body colours by least squares of what the interface (K, P) leaves, less where light is missing."""
        values = self.values - self.colour * interface[:, None]
        body, weight = np.zeros(values.shape[1:]), self.weights(None)
        for _ in range(BODY_PASSES):
            power = np.einsum("kcp,kp->cp", weight, self.body**2)
            body = np.einsum("kcp,kp,kcp->cp", weight, self.body, values) / np.maximum(power, 1e-30)
            body = np.maximum(body, LEAST_BODY * np.maximum(body.mean(), 1e-30))
            weight = self.weights(self.model(interface, body))
        return body

    def squared_error(self, model: Array) -> float:
        """Of all pixels, clipped values as they are recorded and the model clipped there."""
        model = np.where(self.lower, np.minimum(model, self.values), model)
        known = self.trusted[:, None] | self.lower
        return float(np.sum(np.where(known, self.values - model, 0.0) ** 2))


@dataclass(frozen=True, eq=False)
class Trust:
    """Which values of P pixels under K lamps are valid: trusted (K, P); and which are clipped: lower (K, C, P)."""

    trusted: NDArray[np.bool_]
    lower: NDArray[np.bool_]

    def pixels(self, chosen: NDArray) -> Trust:
        """That of some pixels."""
        return Trust(self.trusted[:, chosen], self.lower[..., chosen])


def trust_of(capture: Capture, views: Views) -> Trust:
    """That of `views`, by the masks and values of `capture`."""
    trusted = np.stack([photograph.mask[views.rows, views.columns] for photograph in capture.photographs])
    lower = np.zeros(views.values.shape, bool)
    for k, photograph in enumerate(capture.photographs):
        raw = photograph.values[views.rows, views.columns].T
        top = photograph.values[photograph.mask].max(initial=0.0)
        lower[k] = ~trusted[k] & (np.nan_to_num(raw) >= CLIPPED * top) & (top > 0.0)
    return Trust(trusted, lower)


def samples_of(views: Views, fit: Fit, place: Array, trust: Trust) -> Samples:
    """The samples of `views`, whose pixels `fit`, `place` and `trust` have."""
    trusted, lower = trust.trusted, trust.lower
    shade, (flat, angle2) = shading(fit.normals, views.to_lamp, views.to_eye, fit.rows), _flat(views, fit.normals)
    even = fit.evenness(place)
    values = np.where(np.isfinite(views.values), views.values, 0.0)
    noise = np.where(np.isfinite(views.variance) & (views.variance > 0.0), views.variance, np.inf)
    known = noise[np.isfinite(noise)]
    noise = np.where(lower, np.median(known) if len(known) else np.inf, noise)
    by_law = even[:, None] * np.stack(shade.by_body, axis=1)
    parts = (even * shade.body, even * shade.interface, by_law, even * flat)
    return Samples(values, trusted, lower, *parts, angle2, fit.interface_colour, noise, noise)


def _flat(views: Views, normals: Array) -> tuple[Array, Array]:
    """F G / cosθ_r (K, P), and φ² [rad²], of all lamps."""
    jit, (lamps, pixels) = arrays(), views.to_lamp.shape[:2]

    def wide(vectors: Array) -> jit.Array3f:  # type: ignore[name-defined]
        return jit.Array3f(np.ascontiguousarray(np.tile(vectors, (lamps, 1)).T, np.float32))

    towards = jit.Array3f(views.to_lamp.reshape(-1, 3).T.astype(np.float32))
    at = cosines(wide(normals), towards, wide(views.to_eye))
    flat = weights_at(at, 0.0, 1.0, dr.opaque(jit.Float, 1e6), N).interface
    half = views.to_lamp + views.to_eye
    cosine = np.einsum("kpi,pi->kp", half, normals) / np.maximum(np.linalg.norm(half, axis=2), 1e-12)
    angle2 = np.arccos(np.clip(cosine, -1.0, 1.0)) ** 2
    return np.array(flat).reshape(lamps, pixels).astype(np.float64), angle2
