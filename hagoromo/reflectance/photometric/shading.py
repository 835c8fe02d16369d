"""Shading: eq. (2)–(6) over all lamps and pixels at once, with its slopes as the normal turns.

The body part is α cosθ_i of MODEL §2, raised by an exponent ε where the photographs ask for it (Minnaert 1941,
reciprocal): (cosθ_i)^ε (cosθ_r)^(ε−1). ε = 1 is Lambert's law; a rough or translucent body is flatter, ε < 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import arrays
from hagoromo.reflectance.torrance_sparrow import torrance_sparrow

Array = NDArray[np.float64]

N = 1.5  # refractive index: photographs of one side under lamps near the eye do not tell it
GRAZING = 0.02  # least cosine of a normal to the eye, and of ε's powers


@dataclass(frozen=True, eq=False)
class Gloss:
    """How each of M materials departs from Lambert: rows (ln β, ln γ, ln ε), (M, 3). β in the unit of the values."""

    rows: Array

    @staticmethod
    def none(count: int) -> Gloss:
        """Materials without an interface, whose body follows Lambert's law."""
        return Gloss(np.tile([-np.inf, np.log(0.3), 0.0], (count, 1)))


class Shading(NamedTuple):
    """Weights of body colour and interface, (K, P) each, and their slopes by the two turns of the normal [1/rad].

    by_width: slope of the interface by ln γ. by_exponent: slope of the body by ln ε.
    """

    body: Array
    interface: Array
    body_turned: tuple[Array, Array]
    interface_turned: tuple[Array, Array]
    by_width: Array
    by_exponent: Array


def shading(normals: Array, to_lamp: Array, to_eye: Array, gloss: Array) -> Shading:
    """Shading of pixels with `normals` (P, 3), under lamps to_lamp (K, P, 3), gloss (P, 3) rows as `Gloss` has them.

    The turns are towards `tangents(normals)`.
    """
    kinds, (lamps, pixels) = arrays(), to_lamp.shape[:2]

    def wide(vectors: Array) -> Any:
        return kinds.Array3f(np.tile(vectors, (lamps, 1)).T.astype(np.float32))

    n, v, (t, b) = wide(normals), wide(to_eye), (wide(turn) for turn in tangents(normals))
    towards = kinds.Array3f(to_lamp.reshape(-1, 3).T.astype(np.float32))
    log_beta, log_gamma, log_epsilon = wide(np.maximum(gloss, -80.0))
    found = []
    for turned in range(3):
        moved = dr.zeros(kinds.Float, lamps * pixels)
        dr.enable_grad(moved)
        # N + δ t, made unit: the angle is arctan δ, its slope 1 at δ = 0
        normal = dr.normalize(n + moved * (t, b, kinds.Array3f(0.0))[turned])
        width = dr.exp(log_gamma + moved if turned == 2 else log_gamma)
        weights = torrance_sparrow(normal, towards, v, 1.0, dr.exp(log_beta), width, N)
        body = flattened(weights.body, dr.dot(normal, v), log_epsilon)
        dr.set_grad(moved, 1.0)
        slopes = dr.forward_to(body, weights.interface)
        found += [dr.detach(body), dr.detach(weights.interface), *slopes]
    exponent = dr.exp(log_epsilon)
    lit = found[0] > 0.0
    both = dr.fmax(dr.dot(n, towards), 1e-4) * dr.fmax(dr.dot(n, v), GRAZING)
    by_exponent = dr.select(lit, found[0] * exponent * dr.log(both), 0.0)
    chosen = [found[0], found[1], found[2], found[6], found[3], found[7], found[11], by_exponent]
    dr.eval(chosen)
    body, interface, b1, b2, i1, i2, by_width, by_exponent = (
        part.numpy().reshape(lamps, pixels).astype(np.float64) for part in chosen
    )
    return Shading(body, interface, (b1, b2), (i1, i2), by_width, by_exponent)


def tangents(normals: Array) -> tuple[Array, Array]:
    """Two unit vectors (P, 3) each that make a right-handed frame with `normals` (P, 3)."""
    aside = np.where(np.abs(normals[:, :1]) < 0.6, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    first = np.cross(aside, normals)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return first, np.cross(normals, first).astype(np.float64)


def turned(normals: Array, angles: Array, to_eye: Array) -> Array:
    """`normals` turned by `angles` (P, 2) [rad] towards their tangents, kept GRAZING on the side of the eye."""
    first, second = tangents(normals)
    moved = normals + angles[:, :1] * first + angles[:, 1:] * second
    moved /= np.linalg.norm(moved, axis=1, keepdims=True)
    short = np.maximum(GRAZING - np.einsum("pi,pi->p", moved, to_eye), 0.0)
    moved += short[:, None] * to_eye
    return moved / np.linalg.norm(moved, axis=1, keepdims=True)


def flattened(incidence: Any, view: Any, log_epsilon: Any) -> Any:
    """The body part: cosθ_i → (cosθ_i)^ε (cosθ_r)^(ε−1), 0 where unlit."""
    lit = incidence > 0.0
    epsilon = dr.exp(log_epsilon)
    power = epsilon * dr.log(dr.fmax(incidence, 1e-4)) + (epsilon - 1.0) * dr.log(dr.fmax(view, GRAZING))
    return dr.select(lit, dr.exp(power), 0.0)
