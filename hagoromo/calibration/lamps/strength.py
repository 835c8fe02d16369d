"""Strength: the strength of a lamp per channel, and its estimate from a mirror image that is not clipped.

The mirror shows the lamp's radiance L times the ball's reflectance ρ; E = ∫ L dΩ over the lamp is the irradiance that
faces it. A pixel of a mirror ball covers the solid angle of its mirrored rays.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hagoromo.calibration.lamps.ball import Array, Ball
from hagoromo.calibration.lamps.highlight import Highlight
from hagoromo.calibration.lamps.reading import solid_angles
from hagoromo.errors import InputError
from hagoromo.least_squares.fit_status import FitStatus

APERTURE, BORDER = 2.0, 3.0  # times the highlight's radius, and [px] beyond: radius over which light is summed
RING = 1.6  # times the aperture: outer radius of the ring in which ambient light is measured
FEWEST = 12  # pixels of the ring


@dataclass(frozen=True, eq=False)
class Strength:
    """intensity (C,) per channel and its standard error: of a far lamp the irradiance that faces it, of a near one that
    times its distance squared [m²]. source: "reference" or "highlight". scatter: standard deviation of the residuals
    over the brightest value. shading: direction (3,) and standard error [°] from a matte ball, None without one.
    statuses: how the fits of the reference ended, one per channel.
    """

    intensity: Array
    standard_error: Array
    source: str
    scatter: float
    shading: tuple[Array, float] | None = None
    statuses: tuple[FitStatus, ...] = ()

    def remarks(self) -> list[str]:
        """One line for each fit that did not converge."""
        return [one.remark("the lamp's strength") for one in self.statuses if not one.converged]

    def record(self) -> dict[str, Any]:
        """The keys of lamps.json about the strength, beside `intensity`."""
        known: dict[str, Any] = {
            "intensity_standard_error": self.standard_error.tolist(),
            "intensity_from": self.source,
        }
        if self.statuses:
            known["intensity_convergence"] = [status.record() for status in self.statuses]
        if self.shading is None:
            return {**known, "intensity_scatter": self.scatter}
        shading = {"to_lamp": self.shading[0].tolist(), "standard_error_deg": self.shading[1]}
        return {**known, "intensity_scatter": self.scatter, "shading": shading}


def highlight_strength(
    light: NDArray, ball: Ball, highlight: Highlight, reflectance: ArrayLike, distance: float = 1.0
) -> Strength:
    """Strength of the lamp from its `highlight` on a mirror ball of `reflectance` (one number, or one per channel).

    light: (height, width, channels) linear, NaN where clipped or unknown. distance: of a near lamp from its image [m].
    `InputError` for a clipped highlight, or one that reaches the ball's edge.
    """
    mirror = np.asarray(reflectance, np.float64)
    if mirror.size not in (1, light.shape[2]) or not ((mirror > 0.0) & (mirror <= 1.0)).all():
        raise InputError(
            f"the ball's reflectance is {mirror.tolist()}: give one number above 0, up to 1, or one per channel"
        )
    rows, columns = np.nonzero(ball.covers(light.shape))
    points = np.stack([columns, rows], axis=1) + np.float64(0.5)
    away = np.hypot(*(points - highlight.centre).T)
    reach = APERTURE * np.sqrt(highlight.pixels / np.pi) + BORDER
    core, ring = away < reach, (away >= reach) & (away < RING * reach)
    values = light[rows, columns].astype(np.float64)
    clipped = int(np.sum(~np.isfinite(values[core]).all(axis=1)))
    if clipped:
        raise InputError(
            f"the highlight is clipped in {clipped} pixels, so it gives no strength: expose shorter, or photograph a "
            "matte reference (--reference) too"
        )
    ambient = values[ring][np.isfinite(values[ring]).all(axis=1)]
    if len(ambient) < FEWEST:
        raise InputError("the highlight reaches the ball's edge, so part of its light is missing: move the ball")
    angle = solid_angles(ball, points[core])
    room, spread = np.median(ambient, axis=0), np.std(ambient, axis=0)
    whole = angle @ (values[core] - room)
    half = angle[away[core] < 0.75 * reach] @ (values[core] - room)[away[core] < 0.75 * reach]
    noise = angle.sum() * spread / np.sqrt(len(ambient))
    error = np.hypot(noise, whole - half)  # light that is still added farther out shows that not all is summed yet
    scale = distance**2 / mirror
    return Strength(scale * whole, scale * error, "highlight", float(np.mean(spread / values[core].max())))
