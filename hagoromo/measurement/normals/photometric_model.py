"""Photometric model: what photographs under many lamps are explained by, and how far they may be off.

    value_kc(p) = s_k(p) [ body_c(p) B_k(p) + I_k(p) ],   s_k(p) = e_k (1 + a_k · place(p)),   B, I as in `shading`

s is the unevenness of the lamps: their strengths e and how each falls off over the object, beside what their place
does to the irradiance. The places themselves may be a little off (`shift`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hagoromo.least_squares import FitStatus
from hagoromo.measurement.normals.shading import Gloss, shading
from hagoromo.measurement.normals.views import Array, Views


@dataclass(frozen=True, eq=False)
class Fit:
    """normals (P, 3), body (C, P), labels (P,) of the materials, gloss, lamps: strength ln e (K,), slope a (K, 2), and
    shift (K, 3) of their places, a far lamp's by its direction [rad], a near one's over its distance; depth, ln of
    the distance of the surface over what it is said to be.

    model_error: relative error of the model beside the noise. variance: (P,) of the normal's direction [rad²], the sum
    over its two turns; inf where not estimated. covariance: (M, 4, 4) of the rows of `gloss`. status: how the fit of
    gloss and lamps ended; pixel_status: (P,) `Status` of the fit of each normal; shape_status: how the
    rounds of normals and surface under near lamps ended. None for what was not fitted so.
    """

    normals: Array
    body: Array
    labels: NDArray[np.intp]
    gloss: Gloss
    strength: Array
    slope: Array
    shift: Array
    depth: float
    model_error: float
    variance: Array
    covariance: Array
    status: FitStatus | None = None
    pixel_status: NDArray[np.int8] | None = None
    shape_status: FitStatus | None = None

    def evenness(self, place: Array) -> Array:
        """s_k (K, P) at `place` (P, 2)."""
        return evenness(self.strength, self.slope, place)

    def pixels(self, chosen: NDArray) -> Fit:
        """The fit of some pixels."""
        names = ("normals", "labels", "variance", *([] if self.pixel_status is None else ["pixel_status"]))
        parts = {name: getattr(self, name)[chosen] for name in names}
        return replace(self, body=self.body[:, chosen], **parts)


def evenness(strength: Array, slope: Array, place: Array) -> Array:
    """s = e (1 + a·place) of lamps with ln e `strength` (K,) and a `slope` (K, 2), at `place` (P, 2): (K, P)."""
    return np.exp(strength)[:, None] * np.maximum(1.0 + slope @ place.T, 0.1)


def predicted(fit: Fit, to_lamp: Array, to_eye: Array) -> Array:
    """(K, C, P) values that the fit gives under even lamps of strength 1 in directions `to_lamp` (K, P, 3)."""
    shade = shading(fit.normals, to_lamp, to_eye, fit.gloss.rows[fit.labels])
    return fit.body[None] * shade.body[:, None] + shade.interface[:, None]


def precision(seen: Views, model_error: float) -> Array:
    """(K, C, P) inverse variance of noise and model error, 0 where a value is not used."""
    return seen.used[:, None] / (seen.variance + (model_error * size(seen)) ** 2)


def size(seen: Views) -> Array:
    """What errors of the model are relative to: the value, or the pixel's mean where a shadow makes that small."""
    return np.maximum(seen.values, seen.values.mean(axis=0))
