"""The ball in the picture: its outline, from a mask or the photographs, and its normals and mirrored directions.

Without a camera the view is orthographic, with directions x right, y up, z to the camera; with one the outline is that
of a cone of rays, and directions are in its world. Lengths on the ball are in its radii.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError
from hagoromo.least_squares.fit_status import scipy_status

Array = NDArray[np.float64]

FEWEST_EDGE_POINTS = 40  # of the mask: fewer are too coarse for a tenth of a degree
ROUND = 0.02  # largest rms deviation of the mask's edge from the outline of a ball, over its radius
MASK_ERROR = 0.5 / np.sqrt(3.0)  # [px] masks follow pixel edges, with a common error of up to half a pixel
SECOND = 0.2  # of the area of a mask's largest part: another part of more is a second ball
EDGE_OUTLIER = 0.5  # [px] deviations above have less weight (Huber)
NUMBER = r"(\d{1,6}(?:\.\d{1,4})?)"
CIRCLE = re.compile(rf"{NUMBER},{NUMBER},{NUMBER}")
PARTLY = 0.01  # of the radius: standard error of an outline that photographs show on a part of the circle
SMALLEST = 6.0  # [px] radius


class Mirrored(NamedTuple):
    """normal: (n, 3) of the ball; to_lamp: (n, 3) direction of the mirrored ray; centre: (3,) of the ball from the eye
    [radii], world axes (0 for an orthographic view).
    """

    normal: Array
    to_lamp: Array
    centre: Array


@dataclass(frozen=True, eq=False)
class Ball:
    """centre (x, y) [px] and radius [px] of the outline, standard errors of the three [px], rms of its edge [px].

    edge: (n, 2) points (x, y) the outline was fitted to [px]. camera: None for an orthographic view. axis: (3,) unit,
    world, to the ball's centre, and angle: half the cone's [rad]; for an orthographic view (0, 0, 1) and 0. source:
    "mask", "search" (reduced photographs) or "photographs"; from_mask: offset of the latter's centre from the mask's
    [px]. softness: standard deviation of the edge's blur [px], None where the photographs do not show the edge.
    edge_share: of a mask's outline, the share that is an edge in the photographs, where they do not show it all around.
    """

    centre: tuple[float, float]
    radius: float
    standard_error: tuple[float, float, float]
    rms: float
    edge: Array
    camera: Camera | None = None
    axis: tuple[float, float, float] = (0.0, 0.0, 1.0)
    angle: float = 0.0
    source: str = "mask"
    softness: float | None = None
    from_mask: tuple[float, float] = (0.0, 0.0)
    edge_share: float | None = None

    def record(self) -> dict[str, Any]:
        """The entry of the ball in lamps.json."""
        return {
            "centre_px": list(self.centre),
            "radius_px": self.radius,
            "standard_error_px": list(self.standard_error),
            "rms_px": self.rms,
            "outline": self.source,
            "centre_from_mask_px": list(self.from_mask),
            "softness_px": self.softness,
            "edge_share": self.edge_share,
        }

    def outline(self, count: int, scale: ArrayLike = 1.0) -> Array:
        """(..., count, 2) points (x, y) [px] around the outline, of balls `scale` (...) times as wide."""
        turn = 2.0 * np.pi * np.arange(count) / count
        ring = np.stack([np.cos(turn), np.sin(turn)], axis=-1)
        scale = np.asarray(scale, np.float64)[..., None, None]
        if self.camera is None:
            return np.array(self.centre) + self.radius * scale * ring
        across, down = _frame(np.array(self.axis))
        ray = np.cos(scale * self.angle) * np.array(self.axis)
        ray = ray + np.sin(scale * self.angle) * (ring[:, :1] * across + ring[:, 1:] * down)
        return self.camera.project(self.camera.position + ray)

    def is_within(self, shape: tuple[int, ...]) -> bool:
        """Whether the whole ball is in a picture of `shape` (height, width)."""
        outline = self.outline(36)
        return bool((outline > 0.0).all() and (outline < (shape[1], shape[0])).all())

    def covers(self, shape: tuple[int, ...]) -> NDArray[np.bool_]:
        """(height, width) where the ball is in a picture of `shape`: pixels whose centre is within the outline."""
        outline = self.outline(360)
        middle = outline.mean(axis=0)
        first, last = (
            np.clip(edge, 0, (shape[1], shape[0])).astype(int)
            for edge in (np.floor(outline.min(axis=0)), np.ceil(outline.max(axis=0)) + 1)
        )
        inside = np.zeros(shape[:2], np.bool_)
        around = outline - middle
        row, column = np.ogrid[first[1] : last[1], first[0] : last[0]]
        x, y = column + 0.5 - middle[0], row + 0.5 - middle[1]
        edge = np.interp(np.arctan2(y, x), np.arctan2(*around.T[::-1]), np.hypot(*around.T), period=2.0 * np.pi)
        inside[first[1] : last[1], first[0] : last[0]] = np.hypot(x, y) < edge
        return inside

    def mirrored(self, points: ArrayLike, off: ArrayLike = (0.0, 0.0, 0.0)) -> Mirrored:
        """Normals and mirrored rays at image points (n, 2) [px]; `off`: errors [px] of x, y of the centre and radius.

        Points outside the ball are moved to its edge.
        """
        points, off = np.asarray(points, np.float64), np.asarray(off, np.float64)
        if self.camera is None:
            x, y = ((points - self.centre - off[:2]) / (self.radius + off[2])).T
            normal = np.stack([x, -y, np.sqrt(np.maximum(1.0 - x * x - y * y, 0.0))], axis=1)
            # L = 2 (N·V) N − V, V = (0, 0, 1)
            return Mirrored(normal, 2.0 * normal[:, 2:] * normal - [0.0, 0.0, 1.0], np.zeros(3))
        ray, middle = self.camera.unproject(points), np.array(self.centre)
        ends = self.camera.unproject(np.stack([middle, middle + off[:2]]))
        axis = np.array(self.axis) + ends[1] - ends[0]
        centre = axis / np.linalg.norm(axis) / np.sin(self.angle * (1.0 + off[2] / self.radius))
        along = ray @ centre
        depth = along - np.sqrt(np.maximum(1.0 - centre @ centre + along**2, 0.0))
        normal = depth[:, None] * ray - centre
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        # D − 2 (N·D) N
        return Mirrored(normal, ray - 2.0 * np.sum(normal * ray, axis=1, keepdims=True) * normal, centre)


def find_ball(mask: NDArray, camera: Camera | None = None) -> Ball:
    """The ball in `mask` (height, width[, channels]), robustly fitted to its edge at half brightness.

    `InputError` when it is cut by the frame, too small, not a disc, or not alone.
    """
    from skimage.measure import find_contours, label

    level = grey(mask)
    half = 0.5 * float(level.max())
    inside = level > half
    if not inside.any():
        raise InputError("the mask is black: paint the ball white")
    if inside[[0, -1]].any() or inside[:, [0, -1]].any():
        raise InputError("the ball is cut by the edge of the picture: photograph the whole ball")
    areas = np.sort(np.bincount(np.asarray(label(inside)).ravel())[1:])[::-1]
    balls = int(np.sum(areas > SECOND * areas[0]))
    if balls > 1:
        raise InputError(f"the mask shows {balls} white parts: give one mask (--mask) per ball, with that ball alone")
    contours: list[NDArray] = find_contours(level, half)
    edge = max(contours, key=len)[:, ::-1] + 0.5
    if len(edge) < FEWEST_EDGE_POINTS:
        raise InputError(f"the ball's edge has {len(edge)} points and {FEWEST_EDGE_POINTS} are needed: move closer")
    ball = fit_ball(edge, camera, MASK_ERROR)
    if not ball.rms < ROUND * ball.radius:
        raise InputError(f"the mask is not a disc: its edge deviates by {ball.rms:.3g} px rms from that of a ball"
                         f" {ball.radius:.4g} px in radius: paint the ball, and nothing else, white")  # fmt: skip
    return ball


def fit_ball(edge: Array, camera: Camera | None, radius_error: float, source: str = "mask") -> Ball:
    """The ball whose outline fits best to `edge` (n, 2) [px]; Huber's loss at half a pixel.

    radius_error: systematic error of the whole edge [px]. `InputError` where the fit does not converge.
    """
    from scipy.optimize import least_squares

    middle = edge.mean(axis=0)
    size = float(np.mean(np.hypot(*(edge - middle).T)))
    if camera is None:

        def deviation(parameters: Array) -> Array:
            return np.hypot(edge[:, 0] - parameters[0], edge[:, 1] - parameters[1]) - parameters[2]

        solved = least_squares(deviation, np.r_[middle, size], loss="huber", f_scale=EDGE_OUTLIER)
        fit = solved.x
        centre, radius, axis, angle = fit[:2], float(fit[2]), np.array([0.0, 0.0, 1.0]), 0.0
    else:
        grazing = camera.unproject(edge)
        if not np.isfinite(grazing).all():
            raise InputError(
                "the ball's edge lies outside the field of the camera's lens: is it the right camera (--camera)?"
            )
        # the rays D that graze the ball make one angle ω with the direction A of its centre: D·A/cos ω = 1
        start = np.linalg.lstsq(grazing, np.ones(len(grazing)), rcond=None)[0]
        start = np.asarray(start / np.linalg.norm(start), np.float64)
        across, down = _frame(start)

        def turned(parameters: Array) -> Array:
            axis = start + parameters[0] * across + parameters[1] * down
            return axis / np.linalg.norm(axis)

        def deviation(parameters: Array) -> Array:
            away = np.linalg.norm(np.cross(grazing, turned(parameters)), axis=1)
            return (np.arctan2(away, grazing @ turned(parameters)) / parameters[2] - 1.0) * size

        width = float(np.mean(np.arccos(np.clip(grazing @ start, -1.0, 1.0))))
        start_of_turn, scale = [0.0, 0.0, width], width / size
        solved = least_squares(deviation, start_of_turn, loss="huber", f_scale=EDGE_OUTLIER, x_scale=scale)
        fit = solved.x
        axis, angle = turned(fit), float(fit[2])
        centre, radius = camera.project(camera.position + axis), size
    status = scipy_status(solved)
    if not status.converged:
        raise InputError(f"{status.remark('the ball')}: paint the mask anew, the ball white and nothing else")
    rms = float(np.sqrt(np.mean(deviation(fit) ** 2)))
    scatter = rms * math.sqrt(3.0 / len(edge))  # neighbouring points of an edge are correlated: every third counts
    errors = (1.414 * scatter, 1.414 * scatter, float(np.hypot(scatter, radius_error)))
    x, y, z = axis.tolist()
    return Ball((float(centre[0]), float(centre[1])), radius, errors, rms, edge, camera, (x, y, z), angle, source)


def grey(image: NDArray) -> Array:
    """Mean of the colour channels (height, width); alpha is ignored."""
    values = image.astype(np.float64)
    return values if values.ndim == 2 else values[..., :3].mean(axis=2)


def _frame(axis: Array) -> tuple[Array, Array]:
    """Two unit vectors at right angles to the unit vector `axis` and to each other."""
    across = np.cross(np.eye(3)[np.argmin(np.abs(axis))], axis)
    across /= np.linalg.norm(across)
    return across, np.cross(axis, across)


def stated(ball: Ball) -> str:
    """Options that state the ball's circle.

    >>> stated(Ball((31.5, 30.5), 11.0, (0.1, 0.1, 0.1), 0.0, np.zeros((0, 2))))
    '--mask 31.5,30.5,11.0 or --ball 31.5,30.5,11.0'
    """
    x, y = ball.outline(90).mean(axis=0).tolist()
    circle = f"{x:.1f},{y:.1f},{ball.radius:.1f}"
    return f"--mask {circle} or --ball {circle}"


def is_circle(text: str) -> bool:
    """Whether `text` states a circle.

    >>> is_circle("253.8,148.3,119.5"), is_circle("mask.png")
    (True, False)
    """
    return CIRCLE.fullmatch(text) is not None


def ball_of_circle(text: str, camera: Camera | None = None) -> Ball:
    """The ball whose outline is the stated circle."""
    numbers = CIRCLE.fullmatch(text)
    if numbers is None:
        raise InputError(f"a circle is x,y,radius [px]: given {text}")
    x, y, radius = map(float, numbers.groups())
    if radius < SMALLEST:
        raise InputError(f"a ball has a radius of {SMALLEST:g} px at least: given {radius:g} ({text})")
    turn = 2.0 * np.pi * np.arange(90) / 90
    edge = np.array([x, y]) + radius * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    return replace(fit_ball(edge, camera, MASK_ERROR), standard_error=(PARTLY * radius,) * 3)
