"""Lamps from a chrome ball: photographs with one lamp each, and a mask of the ball → where the lamps stand.

A mirror ball shows a lamp where its normal halves the angle between eye and lamp (MODEL §7.2). Without a camera the
view is orthographic and directions are x right, y up, z to the camera; with one they are in its world.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError

Array = NDArray[np.float64]

FEWEST_EDGE_POINTS = 40  # of the mask: a circle through fewer is too coarse for a tenth of a degree
ROUND = 0.02  # rms deviation of the mask's edge from the circle, over its radius, up to which it is a ball
LEVELS = (0.3, 0.5, 0.7)  # of the highlight's peak: its centroid is taken at each, the middle one counts
LARGEST_SHARE = 0.05  # of the ball's disc that a highlight may cover; a wider one has no centre worth the name
CONTRAST = 3.0  # a highlight is this many times brighter than the 90th percentile of the ball
DIMMEST = 0.25  # of white: peak of a highlight
MASK_ERROR = 0.5 / np.sqrt(3.0)  # px: masks follow pixel edges, all around off by up to half a pixel
PIXEL_ERROR = 1.0 / np.sqrt(12.0)  # px: standard deviation of a place known to the pixel


@dataclass(frozen=True, eq=False)
class Ball:
    """The ball in the picture: centre (x, y) [px] and radius [px], their standard errors, rms of its edge [px]."""

    centre: tuple[float, float]
    radius: float
    standard_error: tuple[float, float, float]  # of x, y, radius [px]
    rms: float
    edge: Array  # (n, 2) points (x, y) of the mask's edge [px]


@dataclass(frozen=True, eq=False)
class Highlight:
    """The lamp's mirror image: centre (x, y) [px], its standard error [px], size [px²], rival's light over its own."""

    centre: tuple[float, float]
    standard_error: float
    pixels: int
    rival: float


@dataclass(frozen=True, eq=False)
class LampReading:
    """A far lamp read off a ball: to_lamp (3,) unit, standard error [°] of the direction, what it was read from."""

    name: str
    to_lamp: Array
    standard_error_deg: float
    highlight: Highlight

    def record(self) -> dict[str, Any]:
        """An entry of lamps.json: the keys of a capture's lamp, then what is known about it."""
        return {
            "name": self.name,
            "to_lamp": self.to_lamp.tolist(),
            "intensity": 1.0,  # a saturated highlight does not tell
            "standard_error_deg": self.standard_error_deg,
            "highlight_px": list(self.highlight.centre),
            "highlight_standard_error_px": self.highlight.standard_error,
            "rival": self.highlight.rival,
        }


def calibrate_lamps(
    photographs: Mapping[str, NDArray],
    mask: NDArray,
    camera: Camera | None = None,
    progress: Callable[[float, str], None] | None = None,
) -> tuple[Ball, tuple[LampReading, ...]]:
    """One far lamp per photograph of a chrome ball, and the ball.

    photographs: name → (height, width[, channels]) integers. mask: (height, width[, channels]), bright on the ball.
    `InputError` for sizes that differ, a mask that is no whole disc, or a photograph without a highlight.
    """
    if not photographs:
        raise InputError("no photograph of the chrome ball: give one per lamp")
    ball = find_ball(mask)
    readings = []
    for i, (name, photograph) in enumerate(photographs.items()):
        if photograph.shape[:2] != mask.shape[:2]:
            raise InputError(f"{name} is {photograph.shape[:2]} pixels and the mask {mask.shape[:2]}: make them fit")
        try:
            readings.append(read_lamp(name, find_highlight(photograph, ball), ball, camera))
        except InputError as error:
            raise InputError(f"{name}: {error}") from error
        if progress:
            progress((i + 1) / len(photographs), name)
    return ball, tuple(readings)


def find_ball(mask: NDArray) -> Ball:
    """The circle around `mask` (height, width[, channels]), robustly fitted to its edge at half brightness."""
    from skimage.measure import find_contours

    level = _grey(mask)
    half = 0.5 * float(level.max())
    inside = level > half
    if not inside.any():
        raise InputError("the mask is black: paint the ball white")
    if inside[[0, -1]].any() or inside[:, [0, -1]].any():
        raise InputError("the ball is cut by the edge of the picture: photograph the whole ball")
    contours: list[NDArray] = find_contours(level, half)
    edge = max(contours, key=len)[:, ::-1] + 0.5
    if len(edge) < FEWEST_EDGE_POINTS:
        raise InputError(f"the ball's edge has {len(edge)} points and {FEWEST_EDGE_POINTS} are needed: move closer")
    centre_and_radius, deviation = _fit_circle(edge)
    rms = float(np.sqrt(np.mean(deviation**2)))
    radius = float(centre_and_radius[2])
    if not rms < ROUND * radius:
        raise InputError(f"the mask is no disc: its edge is {rms:.3g} px rms off the circle of {radius:.4g} px")
    scatter = rms * np.sqrt(3.0 / len(edge))  # neighbouring points of an edge follow each other: every third counts
    errors = (np.sqrt(2) * scatter, np.sqrt(2) * scatter, float(np.hypot(scatter, MASK_ERROR)))
    return Ball((float(centre_and_radius[0]), float(centre_and_radius[1])), radius, errors, rms, edge)


def find_highlight(photograph: NDArray, ball: Ball) -> Highlight:
    """The lamp's mirror image on the ball: the speck above half the peak that holds most light, by its centroid."""
    light = _grey(photograph)
    white = float(np.iinfo(photograph.dtype).max) if photograph.dtype.kind in "ui" else 1.0
    rows, columns = np.mgrid[: light.shape[0], : light.shape[1]] + 0.5
    on_ball = np.hypot(columns - ball.centre[0], rows - ball.centre[1]) < ball.radius
    light = np.where(on_ball, light, 0.0)
    peak, usual = float(light.max()), float(np.percentile(light[on_ball], 90))
    if peak < DIMMEST * white or peak < CONTRAST * usual:
        raise InputError(f"no highlight on the ball (peak {peak:.3g} of {white:g}): light it, or expose longer")
    centres = []
    for level in LEVELS:
        speck, _ = _brightest_speck(light, level * peak)
        weight = np.where(speck, light - 0.5 * level * peak, 0.0)
        centres.append((float(np.average(columns, weights=weight)), float(np.average(rows, weights=weight))))
    speck, rival = _brightest_speck(light, LEVELS[1] * peak)
    pixels = int(speck.sum())
    if pixels > LARGEST_SHARE * on_ball.sum():
        raise InputError(f"the highlight covers {pixels} pixels of the ball: expose shorter, focus, or use a mirror")
    spread = float(np.std(centres, axis=0).max())
    return Highlight(centres[1], float(np.hypot(spread, PIXEL_ERROR / pixels**0.25)), pixels, rival)


def read_lamp(name: str, highlight: Highlight, ball: Ball, camera: Camera | None = None) -> LampReading:
    """Direction to the lamp that the ball shows at `highlight`, errors propagated from highlight, centre and radius."""
    measured = np.array([*highlight.centre, *ball.centre, ball.radius])
    errors = np.array([highlight.standard_error] * 2 + [*ball.standard_error])
    if camera is None:
        direction = _mirrored(measured)
        gradient = np.stack([_mirrored(measured + e) - direction for e in 0.01 * np.eye(5)]) / 0.01
        degrees = np.degrees(np.linalg.norm(gradient * errors[:, None]))
    else:
        direction, degrees = _mirrored_in_perspective(highlight, ball, camera)
    return LampReading(name, direction, float(degrees), highlight)


def _brightest_speck(light: Array, level: float) -> tuple[NDArray[np.bool_], float]:
    """Where the connected speck above `level` is that holds most light, and the next one's light over its own."""
    from skimage.measure import label

    specks = np.asarray(label(light > level, connectivity=1))
    sums = np.bincount(specks.ravel(), light.ravel())
    sums[0] = 0.0
    order = np.argsort(sums)[::-1]
    return specks == order[0], float(sums[order[1]] / sums[order[0]])


def _mirrored(measured: Array) -> Array:
    """to_lamp from (highlight x, y, centre x, y, radius) [px], orthographic: L = 2 (N·V) N − V, V = (0, 0, 1)."""
    x, y = (measured[0] - measured[2]) / measured[4], -(measured[1] - measured[3]) / measured[4]
    z = np.sqrt(max(1.0 - x * x - y * y, 0.0))
    return 2.0 * z * np.array([x, y, z]) - [0.0, 0.0, 1.0]


def _mirrored_in_perspective(highlight: Highlight, ball: Ball, camera: Camera) -> tuple[Array, float]:
    """to_lamp in the world and its standard error [°].

    The rays D that graze the ball make one angle ω with its centre's direction A: D·A/cosω = 1, linear in A/cosω.
    """
    grazing = camera.unproject(ball.edge)
    axis = np.linalg.lstsq(grazing, np.ones(len(grazing)), rcond=None)[0]
    cos_edge = 1.0 / float(np.linalg.norm(axis))
    axis = axis * cos_edge

    def mirrored(offset: Array) -> Array:
        ray = camera.unproject(np.array(highlight.centre) + offset[:2])
        distance = 1.0 / np.sqrt(1.0 - cos_edge**2) / (1.0 + offset[4] / ball.radius)  # in radii of the ball
        centre = distance * (axis + (camera.unproject(np.array(ball.centre) + offset[2:4]) - middle))
        along = ray @ centre
        depth = along - np.sqrt(max(1.0 - centre @ centre + along**2, 0.0))
        normal = depth * ray - centre
        normal /= np.linalg.norm(normal)
        return ray - 2.0 * (normal @ ray) * normal

    middle = camera.unproject(np.array(ball.centre))
    direction = mirrored(np.zeros(5))
    gradient = np.stack([mirrored(e) - direction for e in 0.01 * np.eye(5)]) / 0.01
    errors = np.array([highlight.standard_error] * 2 + [*ball.standard_error])
    return direction, float(np.degrees(np.linalg.norm(gradient * errors[:, None])))


def _fit_circle(edge: Array) -> tuple[Array, Array]:
    """(x, y, radius) of the circle nearest to `edge` (n, 2) and the deviations (n,); Huber's loss at half a pixel."""
    from scipy.optimize import least_squares

    def deviation(circle: Array) -> Array:
        return np.hypot(edge[:, 0] - circle[0], edge[:, 1] - circle[1]) - circle[2]

    middle = edge.mean(axis=0)
    start = np.r_[middle, np.mean(np.hypot(*(edge - middle).T))]
    fit = least_squares(deviation, start, loss="huber", f_scale=0.5)
    return fit.x, deviation(fit.x)


def _grey(image: NDArray) -> Array:
    """Mean of the colour channels (height, width); alpha does not count."""
    values = image.astype(np.float64)
    return values if values.ndim == 2 else values[..., :3].mean(axis=2)
