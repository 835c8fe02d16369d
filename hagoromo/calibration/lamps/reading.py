"""Reading: the direction to a lamp from its mirror image on a ball, with its error.

A mirror ball shows a lamp where its normal bisects the angle between eye and lamp (MODEL §7.2). The centre of a lamp
several degrees wide is not at the centre of its image, so directions are averaged, not pixels.

Strength: the strength of a lamp per channel, and its estimate from a mirror image that is not clipped.

The mirror shows the lamp's radiance L times the ball's reflectance ρ; E = ∫ L dΩ over the lamp is the irradiance that
faces it. A pixel of a mirror ball covers the solid angle of its mirrored rays.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hagoromo.calibration.lamps.ball import Array, Ball
from hagoromo.calibration.lamps.highlight import AGREE, Highlight
from hagoromo.calibration.lamps.light_on_ball import BallShading
from hagoromo.errors import InputError
from hagoromo.least_squares.fit_status import FitStatus

HALF = 0.5  # standard error per difference between highlight and shading, at least
ALONE = 2.0  # times its error: that of a shading that no highlight confirms
TILT = 0.01  # [px] step of the finite differences
GRID = 60  # points across the ball among which the place is sought that mirrors a direction
APERTURE, BORDER = 2.0, 3.0  # times the highlight's radius, and [px] beyond: radius over which light is summed
RING = 1.6  # times the aperture: outer radius of the ring in which ambient light is measured
FEWEST = 12  # pixels of the ring


@dataclass(frozen=True, eq=False)
class LampReading:
    """A lamp and one ball: to_lamp (3,) unit, standard error [°] of the direction, and the highlight and ball.

    from_shading_deg: angle between the directions by the highlight and by the shading of a ball that is no mirror [°].
    """

    name: str
    to_lamp: Array
    standard_error_deg: float
    highlight: Highlight
    ball: Ball
    from_shading_deg: float | None = None

    def record(self) -> dict[str, Any]:
        """An entry of lamps.json: the keys of a capture's lamp, then its errors and readings."""
        return {
            "name": self.name,
            "to_lamp": self.to_lamp.tolist(),
            "intensity": 1.0,  # not identifiable from a saturated highlight
            "standard_error_deg": self.standard_error_deg,
            "highlight_px": list(self.highlight.centre),
            "highlight_standard_error_px": self.highlight.standard_error,
            "rival": self.highlight.rival,
            "highlight_from": self.highlight.source,
            "dispute": self.highlight.dispute,
            "disputed_px": self.highlight.disputed and list(self.highlight.disputed),
            "from_shading_deg": self.from_shading_deg,
        }


def read_lamp(name: str, highlight: Highlight, ball: Ball, shading: BallShading | None = None) -> LampReading:
    """Direction to the lamp that the ball shows at `highlight`, errors propagated from highlight, centre and radius.

    shading: of a ball that is no mirror; it counts by its error. The error holds half of what both differ by.
    """
    direction = centre_of_lamp(highlight, ball)
    degrees = float(np.degrees(np.linalg.norm(slopes(highlight, ball)[1] * figure_errors(highlight, ball)[:, None])))
    if shading is None:
        return LampReading(name, direction, degrees, highlight, ball)
    apart = float(np.degrees(np.arccos(np.clip(direction @ shading.to_lamp, -1.0, 1.0))))
    both = float(np.hypot(degrees, shading.standard_error_deg))
    if apart > AGREE * both:
        disputed = replace(highlight, dispute="shading")
        return LampReading(name, direction, float(np.hypot(degrees, HALF * apart)), disputed, ball, apart)
    share = (degrees / both) ** 2
    mean = (1.0 - share) * direction + share * shading.to_lamp
    error = max(degrees * shading.standard_error_deg / both, HALF * apart)
    return LampReading(name, mean / np.linalg.norm(mean), error, highlight, ball, apart)


def read_shading(name: str, shading: BallShading, ball: Ball) -> LampReading:
    """Direction to the lamp by the shading of the ball alone, where its highlight is not seen."""
    about = ball.outline(8)
    low, high = about.min(axis=0), about.max(axis=0)
    x, y = np.meshgrid(*(np.linspace(*ends, GRID) for ends in zip(low, high, strict=True)))
    points = np.stack([x.ravel(), y.ravel()], axis=1)
    points = points[np.hypot(*(points - about.mean(axis=0)).T) < ball.radius]
    nearest = points[np.argmax(ball.mirrored(points).to_lamp @ shading.to_lamp)]
    degrees = ALONE * shading.standard_error_deg
    error = 0.5 * np.radians(degrees) * ball.radius
    place = float(nearest[0]), float(nearest[1])
    highlight = Highlight(place, float(error), 0, 0.0, nearest[None], np.ones((3, 1)), "shading")
    return LampReading(name, shading.to_lamp, degrees, highlight, ball, 0.0)


def centre_of_lamp(highlight: Highlight, ball: Ball, off: tuple[float, ...] = (0.0,) * 5) -> Array:
    """(3,) unit direction to the centre of the lamp: the mean over the solid angle of its image.

    On a ball that is no mirror, which spreads the image around its brightest place: what that place mirrors.

    off: errors [px] of the highlight's x, y, the ball's x, y, and its radius.
    """
    points, weight = highlight.points + off[:2], highlight.weights[1]
    if highlight.on_body:
        return ball.mirrored([np.add(highlight.centre, off[:2])], off[2:]).to_lamp[0]
    mean = (weight * solid_angles(ball, points, off[2:])) @ ball.mirrored(points, off[2:]).to_lamp
    return mean / np.linalg.norm(mean)


def solid_angles(ball: Ball, points: Array, off: tuple[float, ...] = (0.0,) * 3) -> Array:
    """(n,) [sr] of the mirrored rays of the pixels at `points` (n, 2); 4/radius² each in an orthographic view."""
    directions = ball.mirrored(points, off).to_lamp
    right, down = (ball.mirrored(points + step, off).to_lamp - directions for step in TILT * np.eye(2))
    return np.linalg.norm(np.cross(right, down), axis=1) / TILT**2


def slopes(highlight: Highlight, ball: Ball) -> tuple[Array, Array]:
    """Slopes (5, 3) per pixel of the point of the ball that mirrors the lamp [radii], and of the direction to the lamp.

    By the five coordinates of `figure_errors`.
    """

    def place(off: Array) -> Array:
        shown = ball.mirrored(np.array([highlight.centre]) + off[:2], off[2:])
        return shown.centre + shown.normal[0]

    steps, zero = TILT * np.eye(5), np.zeros(5)
    of_place = np.stack([place(step) for step in steps]) - place(zero)
    of_lamp = np.stack([centre_of_lamp(highlight, ball, tuple(step)) for step in steps]) - centre_of_lamp(
        highlight, ball
    )
    return of_place / TILT, of_lamp / TILT


def figure_errors(highlight: Highlight, ball: Ball) -> Array:
    """(5,) standard errors [px] of the highlight's x, y, the ball's x, y, and its radius."""
    return np.array([highlight.standard_error] * 2 + [*ball.standard_error])


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
