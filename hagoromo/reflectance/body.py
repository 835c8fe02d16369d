"""Body: how the body (diffuse) part departs from Lambert's law, by an exponent (Minnaert) and a roughness (Oren–Nayar).

    f_body = α c_b cosθ_i (cosθ_i cosθ_r)^ε (1 + σ s/t),   s = L·V − cosθ_i cosθ_r
    t = max(cosθ_i, cosθ_r) where s > 0, else 1

The exponent is that of Minnaert (1941), who writes k = 1 + ε: below 0 the limb is brighter than Lambert's law has it,
above 0 darker. The roughness is that of Oren and Nayar (1994) in the form of Fujii: more light goes back to the lamp.
The factor does not change when lamp and eye change places, so the body stays reciprocal. Cosines in it are
LEAST_COSINE or more: below, at grazing angles, it is held, so that it is finite for every ε.

A law of the body is a dataclass of its parameters, derived from `LambertBody`; `BodyLaw` in `parameters.py` has all of
them as its bases.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import Float, arrays

LEAST_COSINE = 0.02  # smallest cosine, and smallest t, in the factor
EPSILON_RANGE = (-0.9, 4.0)  # admissible ε
SIGMA_RANGE = (-0.5, 1.0)  # admissible σ: above 1 a body would send back less than nothing away from the lamp
NODES = 32  # of each angle, over which the albedo is integrated


@dataclass(frozen=True, kw_only=True)
class LambertBody:
    """Lambert's law, from which every law of the body departs: by the angles of its light, or by its colour.

    Each law multiplies what `super()` gives, so that laws can be joined. Its parameters are numbers, or Dr.Jit arrays
    in kernels; at their plain values it leaves what `super()` gives as it is, so that kernels hold nothing of it.
    """

    def body_factor(self, incidence: Float, view: Float, phase: Float) -> Float:
        """Factor on α c_b cosθ_i of a plane: the number 1 for Lambert's law.

        incidence, view: cosθ_i and cosθ_r, above 0 where the body is seen and lit. phase: L·V.
        """
        return 1.0

    def shown_colour(self, colour: Any, alpha: Float) -> Any:
        """Body colour as it shows, from c_b: numbers of any kind, one by one; the same object where nothing changes it.

        alpha: weight of the body α [1/sr].
        """
        return colour


LAMBERT = LambertBody()


@dataclass(frozen=True, kw_only=True)
class RoughBody(LambertBody):
    """epsilon: exponent ε of the body. sigma: its roughness σ. See `body_factor`; both 0: Lambert's law."""

    epsilon: float = 0.0
    sigma: float = 0.0

    def body_factor(self, incidence: Float, view: Float, phase: Float) -> Float:
        """`body_factor` of its ε and σ."""
        whole = super().body_factor(incidence, view, phase)
        if is_number(self.epsilon, 0.0) and is_number(self.sigma, 0.0):
            return whole
        return whole * body_factor(incidence, view, phase, self.epsilon, self.sigma)


def is_number(value: Float, number: float) -> bool:
    """Whether a value is this number, and not an array, so that kernels need not compute with it."""
    return isinstance(value, (int, float)) and value == number


def body_factor(incidence: Float, view: Float, phase: Float, epsilon: Float, sigma: Float) -> Float:
    """(cosθ_i cosθ_r)^ε (1 + σ s/t), 1 for ε = σ = 0.

    incidence, view: cosθ_i and cosθ_r, above 0 where the body is seen and lit. phase: L·V.
    """
    lit, seen = dr.fmax(incidence, LEAST_COSINE), dr.fmax(view, LEAST_COSINE)
    return dr.exp(epsilon * dr.log(lit * seen)) * dr.fmax(1.0 + sigma * retroreflection(incidence, view, phase), 0.0)


def retroreflection(incidence: Float, view: Float, phase: Float) -> Float:
    """s/t of `body_factor`."""
    s = phase - incidence * view
    return s / dr.select(s > 0.0, dr.fmax(dr.fmax(incidence, view), LEAST_COSINE), 1.0)


@lru_cache(maxsize=256)
def body_albedo_ratio(law: LambertBody, views: tuple[float, ...]) -> NDArray[np.float64]:
    """Albedo of the body of a plane over that of Lambert's law, π α c_b, from `views` against its normal [rad].

    (views,): ∫ cosθ_i `law.body_factor` dL / π. c_b: the colour as it shows.
    """
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    squared, weights = 0.5 * (nodes + 1.0), 0.5 * weights  # cosθ_i dL = ½ d(sin²θ_i) dψ
    turns = math.pi * (np.arange(2 * NODES) + 0.5) / (2 * NODES)  # one half of the turn: the other is alike
    real: Any = arrays().Float64
    view, sine2, turn = dr.meshgrid(*(real(part) for part in (np.array(views), squared, turns)), indexing="ij")
    incidence, sine = dr.sqrt(1.0 - sine2), dr.sqrt(sine2)
    seen = dr.cos(view)
    phase = sine * dr.sin(view) * dr.cos(turn) + incidence * seen
    factor = np.array(law.body_factor(incidence, seen, phase))
    values = np.broadcast_to(factor, len(views) * NODES * turns.size).reshape(len(views), NODES, -1)
    return np.asarray(values.mean(axis=2) @ weights, np.float64)


def diffuse_albedo_ratio(law: LambertBody) -> float:
    """Albedo of the body under even light from everywhere over that of Lambert's law: the mean over all views."""
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    squared = 0.5 * (nodes + 1.0)
    return float(0.5 * weights @ body_albedo_ratio(law, tuple(np.arccos(np.sqrt(squared)).tolist())))
