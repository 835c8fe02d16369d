"""Integrability: the 3 × 3 matrices for which the normals are those of a surface.

With true lamps s = C ŝ and true pixels b = C⁻ᵀ b̂, v the ray of a pixel, (x', y', −1), x right, y up, the surface's
depth has one curl-free gradient where (b_y × b)·(v_x × v) = (b_x × b)·(v_y × v). As C⁻ᵀ is the matrix of cofactors, up
to scale, C acts on the products of b̂ themselves, and the condition is linear in the rows of C:

    c₁·K_x + c₂·K_y + c₃·(x' K_x + y' K_y) = 0,     K_x = b̂_x × b̂,  K_y = b̂_y × b̂

(Yuille and Snow 1997; Belhumeur, Kriegman and Yuille 1999; in perspective Papadhimitri and Favaro 2013, "A new
perspective on uncalibrated photometric stereo"). In an orthographic view the last term vanishes and c₃ stays free: the
generalised bas-relief ambiguity. Products of opposite neighbours serve as derivatives, and albedo cancels in them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hagoromo.calibration.lamps.uncalibrated.low_rank import Array
from hagoromo.least_squares.fit_status import FitStatus, Status
from hagoromo.least_squares.loss import robust_scale

INTEGRABILITY_REWEIGHTINGS = 15
LARGEST_CHANGE = 1e-3  # of c₁ and c₂ in the last reweighting of a fit that has converged
CLIP = 2.0  # scales of the residual above which a pixel (an edge, a shadow) has less weight


@dataclass(frozen=True, eq=False)
class IntegrabilityRows:
    """along (n, 6): K_x and K_y side by side; beyond (n, 3): x' K_x + y' K_y; place (n, 2): row and column."""

    along: Array
    beyond: Array
    place: NDArray[np.intp]

    def chosen(self, index: NDArray) -> IntegrabilityRows:
        """Some of the rows."""
        return IntegrabilityRows(self.along[index], self.beyond[index], self.place[index])


def rows(pixels: Array, step: int, tangent: Array) -> IntegrabilityRows:
    """One row per pixel of `pixels` (h, w, 3), NaN off the object, that has its neighbours at `step` on the object.

    tangent: (h, w, 2) x', y' of the rays; zeros for an orthographic view.
    """
    pitch = tangent[0, 1, 0] - tangent[0, 0, 0], tangent[0, 0, 1] - tangent[1, 0, 1]  # of pixels, right and up
    aspect = np.sqrt(pitch[0] / pitch[1]) if min(pitch) > 0.0 else 1.0
    right, left = np.roll(pixels, -step, axis=1), np.roll(pixels, step, axis=1)
    up, down = np.roll(pixels, step, axis=0), np.roll(pixels, -step, axis=0)
    across, along = _product(right, left), _product(up, down)
    usable = np.asarray(np.isfinite(across + along).all(axis=2))
    usable[:step] = usable[-step:] = usable[:, :step] = usable[:, -step:] = False
    place = np.argwhere(usable)
    k_x, k_y, rays = across[usable] / aspect, along[usable] * aspect, tangent[usable]
    return IntegrabilityRows(np.c_[k_x, k_y], rays[:, :1] * k_x + rays[:, 1:] * k_y, place)


def first_rows(lines: IntegrabilityRows) -> tuple[Array, float, FitStatus]:
    """c₁ and c₂ (2, 3) of unit length together, their uncertainty from 0 (none) to 1, and how the fit ended."""
    weight, ratio = np.ones(len(lines.along)), 1.0
    best, change = np.zeros(6), np.inf
    for _ in range(INTEGRABILITY_REWEIGHTINGS):
        last = best
        values, vectors = np.linalg.eigh(lines.along.T @ (lines.along * weight[:, None]))
        best, ratio = vectors[:, 0], float(np.sqrt(max(values[0], 0.0) / values[1]))
        change = float(min(np.linalg.norm(best - last), np.linalg.norm(best + last)))  # its sign is free
        weight = _weight(lines.along @ best)
    status = Status.CONVERGED if change < LARGEST_CHANGE else Status.OUT_OF_STEPS
    return best.reshape(2, 3), ratio, FitStatus(status, INTEGRABILITY_REWEIGHTINGS, last_step=change)


def _weight(off: Array) -> Array:
    return 1.0 / (1.0 + (off / max(CLIP * robust_scale(off), 1e-30)) ** 2)


def _product(one: Array, other: Array) -> Array:
    lengths = np.linalg.norm(one, axis=2) * np.linalg.norm(other, axis=2)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.cross(one, other) / lengths[..., None]
