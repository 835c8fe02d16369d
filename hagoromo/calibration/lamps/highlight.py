"""Highlight: the lamp's mirror image on the ball, and the direction to the lamp.

A mirror ball shows a lamp where its normal bisects the angle between eye and lamp (MODEL §7.2). The centre of a lamp
several degrees wide is not at the centre of its image, so directions are averaged, not pixels.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.calibration.lamps.ball import Array, Ball, grey
from hagoromo.calibration.lamps.speck import ellipse_centre
from hagoromo.calibration.lamps.streaks import where_streaks_meet
from hagoromo.errors import InputError

LEVELS = (0.3, 0.5, 0.7)  # of the highlight's peak: thresholds of centroids; the middle one is used
LARGEST_SHARE = 0.05  # of the ball's disc that a highlight may cover; a wider one has no accurate centre
CONTRAST = 3.0  # smallest ratio of a highlight's peak to the 90th percentile of the ball
DIMMEST = 0.25  # of white: smallest peak of a highlight
STANDS_OUT = 8.0  # smallest ratio of peak to 90th percentile, both above the median: noise does not reach it
CORE_BLURS, CORE_LEVEL = (1.5, 2.5, 4.0), 0.85  # [px] standard deviations; of the blurred peak: pixels of the core
TIP_LEVELS = (0.9, 0.97)  # of the peak: the brightest pixels
FEWEST_IN_TIP, SLANT, FILLED = 4, 0.4, 0.8  # pixels of them; their width over length; of the area of their ellipse
ASTRAY_CORE = 0.5  # [px] between centroid and core: more is glare
SMALLEST_WITH_CORE = 10.0 * CORE_BLURS[-1]  # [px] radius of a ball: on smaller ones blurring moves the peak off the rim
SMALLEST_WITH_STREAKS = 30.0  # [px] radius of a ball: on smaller ones streaks are hardly longer than wide
PIXEL_ERROR = 1.0 / np.sqrt(12.0)  # [px] standard deviation of a position known to the pixel
TILT = 0.01  # [px] step of the finite differences


@dataclass(frozen=True, eq=False)
class Highlight:
    """The lamp's mirror image: centre (x, y) [px], its standard error [px], size [px²], rival's light over its own.

    points: (n, 2) [px] of its pixels above the lowest level, weights: (levels, n) of their light.
    """

    centre: tuple[float, float]
    standard_error: float
    pixels: int
    rival: float
    points: Array
    weights: Array


@dataclass(frozen=True, eq=False)
class LampReading:
    """A lamp and one ball: to_lamp (3,) unit, standard error [°] of the direction, and the highlight and ball."""

    name: str
    to_lamp: Array
    standard_error_deg: float
    highlight: Highlight
    ball: Ball

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
        }


def find_highlight(photograph: NDArray, ball: Ball) -> Highlight:
    """The lamp's mirror image on the ball: the speck above half the peak with most light, located by its centroid.

    Streaks of glare draw a centroid aside. Where the speck is no ellipse, and its centroid is more than ASTRAY_CORE
    from that of the brightest pixels, these are the lamp if they are as compact as a disc; where streaks are as bright
    as the lamp, it is where they meet, on balls of a radius of SMALLEST_WITH_STREAKS or more, and if they lie along one
    line the peak of the blurred light, on balls of SMALLEST_WITH_CORE or more.

    photograph: (height, width[, channels]) integers, or light as floats, NaN where it is clipped or unknown.
    """
    light, speck, rival, brightest, corner, share = lamp_speck(photograph, ball)
    pixels = int(speck.sum())
    if pixels > LARGEST_SHARE * share:
        raise InputError(f"the highlight covers {pixels} pixels of the ball: expose shorter, focus, or use a mirror")
    weights = np.stack([_weight(light, level * brightest) for level in LEVELS])
    rows, columns = np.nonzero(weights.any(axis=0))
    points, weights = np.stack([columns, rows], axis=1) + corner[::-1] + np.float64(0.5), weights[:, rows, columns]
    centres = weights @ points / weights.sum(axis=1, keepdims=True)
    (x, y), error = centres[1], float(np.hypot(np.std(centres, axis=0).max(), PIXEL_ERROR / pixels**0.25))
    finer = ellipse_centre(light / brightest, speck)
    if finer is not None:
        centre = np.array([finer.x, finer.y]) + corner[::-1]
        points, (x, y), error = points + (centre - centres[1]), centre, finer.standard_error
    else:
        core = _tip(light, brightest) or _meeting(light, speck, ball.radius)
        if core is not None and np.hypot(*(core.centre + corner[::-1] - centres[1])) > ASTRAY_CORE:
            points, weights = core.points + corner[::-1], np.tile(core.weights, (len(LEVELS), 1))
            (x, y), error = core.centre + corner[::-1], float(np.hypot(core.spread, PIXEL_ERROR))
    return Highlight((float(x), float(y)), error, pixels, rival, points, weights)


class LampSpeck(NamedTuple):
    """The brightest speck on a ball.

    light: (h, w) of the box around the ball, 0 beside it. speck: (h, w) above half of the peak. rival: light of the
    next speck over its own. brightest: the peak. corner: (row, column) of the box. share: pixels of the ball.
    """

    light: Array
    speck: NDArray[np.bool_]
    rival: float
    brightest: float
    corner: Array
    share: int


def lamp_speck(photograph: NDArray, ball: Ball) -> LampSpeck:
    """The brightest speck on the ball; `InputError` where nothing stands out as a lamp's image does."""
    whole, on_ball = photograph.dtype.kind in "ui", ball.covers(photograph.shape)
    corner = np.array([axis.min() for axis in np.nonzero(on_ball)])
    about = tuple(slice(axis.min(), axis.max() + 1) for axis in np.nonzero(on_ball))
    light, on_ball = grey(photograph[about]), on_ball[about]
    known = light[on_ball & np.isfinite(light)]
    if not known.size:
        raise InputError("no pixel of the ball is known: expose shorter")
    brightest = float(known.max())
    white = float(np.iinfo(photograph.dtype).max) if whole else brightest
    light = np.where(on_ball, np.where(np.isfinite(light), light, brightest), 0.0)
    median, usual = np.percentile(light[on_ball], [50, 90]).tolist()
    noise = not whole and brightest - median < STANDS_OUT * (usual - median)  # where white is unknown
    if noise or brightest < DIMMEST * white or brightest < CONTRAST * usual or brightest <= 0.0:
        raise InputError(f"no highlight on the ball (peak {brightest:.3g} of {white:g}): light it, or expose longer")
    speck, rival = _brightest_speck(light, LEVELS[1] * brightest)
    return LampSpeck(light, speck, rival, brightest, corner, int(on_ball.sum()))


def read_lamp(name: str, highlight: Highlight, ball: Ball) -> LampReading:
    """Direction to the lamp that the ball shows at `highlight`, errors propagated from highlight, centre and radius."""
    direction = centre_of_lamp(highlight, ball)
    degrees = np.degrees(np.linalg.norm(slopes(highlight, ball)[1] * figure_errors(highlight, ball)[:, None]))
    return LampReading(name, direction, float(degrees), highlight, ball)


def centre_of_lamp(highlight: Highlight, ball: Ball, off: tuple[float, ...] = (0.0,) * 5) -> Array:
    """(3,) unit direction to the centre of the lamp: the mean over the solid angle of its image.

    off: errors [px] of the highlight's x, y, the ball's x, y, and its radius.
    """
    points, weight = highlight.points + off[:2], highlight.weights[1]
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


class _Core(NamedTuple):
    """The core of a lamp's image: centre (x, y) [px], its spread over blurs or levels [px], its pixels, their light."""

    centre: Array
    spread: float
    points: Array
    weights: Array


def _tip(light: Array, brightest: float) -> _Core | None:
    """The brightest pixels, where they are as compact as a disc seen at a slant: glare below them is left out."""
    centres: list[Array] = []
    points: Array = np.zeros((0, 2))
    for level in TIP_LEVELS:
        speck, _ = _brightest_speck(light, level * brightest)
        points = np.argwhere(speck)[:, ::-1].astype(np.float64) + 0.5
        if len(points) < FEWEST_IN_TIP:
            return None
        small, large = np.linalg.eigvalsh(np.cov(points.T) + np.eye(2) / 12.0)
        # the area of an ellipse is 4π √(det of its second moments)
        if small < SLANT**2 * large or len(points) < FILLED * 4.0 * np.pi * np.sqrt(small * large):
            return None
        centres.append(points.mean(axis=0))
    return _Core(centres[-1], float(np.std(centres, axis=0).max()), points, np.ones(len(points)))


def _core(light: Array) -> _Core:
    """Where the light peaks when it is blurred: a wide bright disc keeps its light then, thin streaks lose it."""
    from scipy.ndimage import gaussian_filter

    cores = []
    for blur in CORE_BLURS:
        blurred = gaussian_filter(light, blur, mode="constant")
        speck, _ = _brightest_speck(blurred, CORE_LEVEL * float(blurred.max()))
        rows, columns = np.nonzero(speck)
        points, weights = np.stack([columns, rows], axis=1) + 0.5, blurred[rows, columns]
        cores.append((weights @ points / weights.sum(), points, weights))
    centre, points, weights = cores[len(cores) // 2]
    spread = float(np.std([core[0] for core in cores], axis=0).max())
    return _Core(centre, spread, points, weights)


def _meeting(light: Array, speck: NDArray[np.bool_], radius: float) -> _Core | None:
    """Where the streaks of the speck meet; `_core` where they lie along one line; None on a ball too small for it."""
    found = where_streaks_meet(light, speck) if radius >= SMALLEST_WITH_STREAKS else None
    if found is not None:
        return _Core(found[0], found[1], found[0][None], np.ones(1))
    return _core(light) if radius >= SMALLEST_WITH_CORE else None


def _weight(light: Array, level: float) -> Array:
    speck, _ = _brightest_speck(light, level)
    return np.where(speck, light - 0.5 * level, 0.0)


def _brightest_speck(light: Array, level: float) -> tuple[NDArray[np.bool_], float]:
    """Mask of the connected speck above `level` with most light, and the light of the next one over its own."""
    from skimage.measure import label

    specks = np.asarray(label(light > level, connectivity=1))
    sums = np.bincount(specks.ravel(), light.ravel())
    sums[0] = 0.0
    order = np.argsort(sums)[::-1]
    return specks == order[0], float(sums[order[1]] / sums[order[0]])
