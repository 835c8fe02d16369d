"""Unknown light: what a surface sends out under light that nobody measured, as a smooth function of its normal.

The light that is sent out is body colour × E(n). E is a polynomial of second order of the normal, which holds all but
1 % of the irradiance by distant light without shadows (Ramamoorthi and Hanrahan 2001), in the axes of what the light is
fixed to: of the object, or of the camera where lamps move with it or the object turns before them. The mean of E over
all normals is 1. Body colours take the rest: shadows, near lamps, and how bright the light is.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import Array3f, Float, UInt, arrays, lookup
from hagoromo.matter.shape import unit
from hagoromo.photograph.photograph import Photograph
from hagoromo_recovery.field.matter_field import COLOURS, MatterField

Frame = Literal["object", "camera"]  # what the light is fixed to
TERMS = 9  # of a polynomial of second order on the sphere
DARKEST = 0.02  # irradiance at least, of its mean
RIDGE = 1e-3  # of the mean eigenvalue: what no photograph shows stays 0
OPAQUE = 0.9  # opacity from which a pixel shows the surface alone
DAMPED = 0.5  # share of a step that is taken
MEAN_CHANGE = (0.5, 2.0)  # factors on body colours in a step, at most
# rows of the first and of the second order, and the largest root of their sum of squares: that of one far lamp, as
# light is not negative
BANDS = ((slice(1, 4), 2.0 / np.sqrt(3.0)), (slice(4, TERMS), 0.25 * np.sqrt(5.0)))


def harmonics(n: Array3f) -> list[Float]:
    """Real spherical harmonics of a unit vector up to order 2, with a mean square of 1 over all directions."""
    a, b, c = float(np.sqrt(3.0)), float(np.sqrt(15.0)), float(np.sqrt(5.0) / 2.0)
    x, y, z = n[0], n[1], n[2]
    linear = [a * x, a * y, a * z]
    return [0.0 * x + 1.0, *linear, b * x * y, b * y * z, b * z * x, 0.5 * b * (x * x - y * y), c * (3.0 * z * z - 1.0)]


def within_bounds(coefficients: NDArray[np.floating]) -> NDArray[np.float64]:
    """Coefficients (TERMS, COLOURS) of a light of mean 1, those of higher orders no larger than light can have them."""
    bounded = np.array(coefficients, np.float64)
    bounded[0] = 1.0
    for rows, most in BANDS:
        length = np.sqrt((bounded[rows] ** 2).sum(axis=0))
        bounded[rows] *= np.minimum(1.0, most / np.maximum(length, most))
    return bounded


class UnknownLight:
    """The light of all photographs. frame: what it is fixed to. coefficients: (TERMS, COLOURS) of E, the first ones 1.

    photographs: those that rays have the numbers of.
    """

    def __init__(
        self, frame: Frame, photographs: Sequence[Photograph], coefficients: NDArray[np.floating] | None = None
    ) -> None:
        self.frame: Frame = frame
        turns = [p.camera.world_to_camera[:3, :3] if frame == "camera" else np.eye(3) for p in photographs]
        self.turns = lookup(arrays().Float, np.stack(turns).astype(np.float32))
        plain = np.zeros((TERMS, COLOURS))
        plain[0] = 1.0
        self._set(plain if coefficients is None else coefficients)

    def _set(self, coefficients: NDArray[np.floating]) -> None:
        self.coefficients = np.asarray(coefficients, np.float64)
        self.table = lookup(arrays().Float, self.coefficients.astype(np.float32))

    def of(self, photographs: Sequence[Photograph]) -> UnknownLight:
        """The same light on other photographs."""
        return UnknownLight(self.frame, photographs, self.coefficients)

    def irradiance(self, photograph: UInt, normal: Array3f) -> list[Float]:
        """E(n) of each channel."""
        jit, terms, light = arrays(), harmonics(self._turned(photograph, normal)), []
        for c in range(COLOURS):
            numbers = [dr.gather(jit.Float, self.table, jit.UInt(k * COLOURS + c)) for k in range(TERMS)]
            light.append(dr.fmax(sum(a * b for a, b in zip(numbers, terms, strict=True)), DARKEST))
        return light

    def _turned(self, photograph: UInt, normal: Array3f) -> Array3f:
        """A normal in the axes of what the light is fixed to."""
        jit, turned = arrays(), []
        for i in range(3):
            row = [dr.gather(jit.Float, self.turns, photograph * 9 + (3 * i + k)) for k in range(3)]
            turned.append(sum(row[k] * normal[k] for k in range(3)))
        return jit.Array3f(*turned)

    def fit(self, field: MatterField, drawn: Any, light: Any, weights: Sequence[Float]) -> None:
        """Half a step to the coefficients that explain some pixels best. light: what they show (`SeenLight`).

        weights: of the pixels' channels. Body colours are scaled so that the mean of E stays 1.
        """
        with dr.suspend_grad():
            place = dr.fma(drawn.rays.direction, light.seen.way, drawn.rays.origin)
            terms = harmonics(self._turned(drawn.photograph, unit(field.axis_at(place))))
            colours = field.colours_at(place)
        opacity = light.opacity.astype(np.float64)
        hit = opacity > OPAQUE
        if not hit.any():
            return
        basis, new = np.stack([np.array(t, np.float64) for t in terms], axis=1)[hit], self.coefficients.copy()
        for c in range(COLOURS):
            design = basis * (opacity * np.array(colours[c], np.float64))[hit, None]
            weighted = design * np.array(weights[c], np.float64)[hit, None]
            matrix = weighted.T @ design
            matrix += RIDGE * np.trace(matrix) / TERMS * np.diag([0.0] + [1.0] * (TERMS - 1))
            if matrix[0, 0] > 0.0:
                side = weighted.T @ np.array(drawn.values[c], np.float64)[hit]
                new[:, c] += DAMPED * (np.linalg.solve(matrix, side) - new[:, c])
        mean = np.clip(new[0], *MEAN_CHANGE)
        self._set(within_bounds(new / mean))
        field.scale_colours(mean)
