"""Integrability: of all 3 × 3 matrices, those that make the normals those of a surface.

With true lamps s = C ŝ and true pixels b = C⁻ᵀ b̂, v the ray of a pixel, (x', y', −1), x right, y up, the surface's
depth has one curl-free gradient where (b_y × b)·(v_x × v) = (b_x × b)·(v_y × v). As C⁻ᵀ is the matrix of cofactors, up
to scale, C acts on the products of b̂ themselves, and the condition is linear in the rows of C:

    c₁·K_x + c₂·K_y + c₃·(x' K_x + y' K_y) = 0,     K_x = b̂_x × b̂,  K_y = b̂_y × b̂

(Yuille and Snow 1997; Belhumeur, Kriegman and Yuille 1999; in perspective Papadhimitri and Favaro 2013, "A new
perspective on uncalibrated photometric stereo"). From afar the last term vanishes and c₃ stays free: the generalised
bas-relief ambiguity. Products of neighbours left and right are as good as derivatives, and albedo drops out of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hagoromo.calibration.lamps.uncalibrated.low_rank import Array
from hagoromo.least_squares import FitStatus, Status, robust_scale

INTEGRABILITY_REWEIGHTINGS = 15
STANDSTILL = 1e-3  # change of c₁ and c₂ in the last of them, beyond which they have not converged
CLIP = 2.0  # scales of the residual beyond which a pixel (an edge, a shadow) counts less


@dataclass(frozen=True, eq=False)
class Rows:
    """along (n, 6): K_x and K_y side by side; beyond (n, 3): x' K_x + y' K_y; place (n, 2): row and column."""

    along: Array
    beyond: Array
    place: NDArray[np.intp]

    def chosen(self, index: NDArray) -> Rows:
        """Some of the rows."""
        return Rows(self.along[index], self.beyond[index], self.place[index])


def rows(pixels: Array, step: int, tangent: Array) -> Rows:
    """One row per pixel of `pixels` (h, w, 3), NaN off the object, whose neighbours at `step` are on it.

    tangent: (h, w, 2) x', y' of the rays; zeros for a view from afar.
    """
    pitch = tangent[0, 1, 0] - tangent[0, 0, 0], tangent[0, 0, 1] - tangent[1, 0, 1]  # of pixels, right and up
    aspect = np.sqrt(pitch[0] / pitch[1]) if min(pitch) > 0.0 else 1.0
    right, left = np.roll(pixels, -step, axis=1), np.roll(pixels, step, axis=1)
    up, down = np.roll(pixels, step, axis=0), np.roll(pixels, -step, axis=0)
    across, along = _product(right, left), _product(up, down)
    told = np.asarray(np.isfinite(across + along).all(axis=2))
    told[:step] = told[-step:] = told[:, :step] = told[:, -step:] = False
    place = np.argwhere(told)
    k_x, k_y, at = across[told] / aspect, along[told] * aspect, tangent[told]
    return Rows(np.c_[k_x, k_y], at[:, :1] * k_x + at[:, 1:] * k_y, place)


def first_rows(found: Rows) -> tuple[Array, float, FitStatus]:
    """c₁ and c₂ (2, 3) of unit length together, how well they are told, 0 (well) to 1, and how the fit ended."""
    weight, ratio = np.ones(len(found.along)), 1.0
    best, change = np.zeros(6), np.inf
    for _ in range(INTEGRABILITY_REWEIGHTINGS):
        last = best
        values, vectors = np.linalg.eigh(found.along.T @ (found.along * weight[:, None]))
        best, ratio = vectors[:, 0], float(np.sqrt(max(values[0], 0.0) / values[1]))
        change = float(min(np.linalg.norm(best - last), np.linalg.norm(best + last)))  # its sign is free
        weight = _weight(found.along @ best)
    status = Status.CONVERGED if change < STANDSTILL else Status.OUT_OF_STEPS
    return best.reshape(2, 3), ratio, FitStatus(status, INTEGRABILITY_REWEIGHTINGS, last_step=change)


def _weight(off: Array) -> Array:
    return 1.0 / (1.0 + (off / max(CLIP * robust_scale(off), 1e-30)) ** 2)


def _product(one: Array, other: Array) -> Array:
    lengths = np.linalg.norm(one, axis=2) * np.linalg.norm(other, axis=2)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.cross(one, other) / lengths[..., None]
