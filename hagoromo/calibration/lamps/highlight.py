"""Highlight: where a ball shows the image of a lamp.

An image that is an ellipse, blurred and clipped, is located by fitting one. Streaks of glare and scratches make it
something else: then its widest part is the lamp, and the place where its streaks meet is heard where both agree.

Speck: the centre of a clipped highlight, by fitting a blurred and clipped ellipse.

Clipping turns every pixel that the lamp's image touches white, so the centroid follows the edges of the pixels, with
an error of one or two tenths of a pixel. The grey pixels around it show where the image ends.

Streaks: the place where streaks of glare meet, which is the lamp's image.

The edges of a streak run towards the lamp, or past it at half of the streak's width, one on either side. So the centre
c is where Σ w ((p − c) · g)² is least, over pixels p with the slope g of their light (Förstner 1987). Ends of streaks,
whose slope points along them, are outliers of Cauchy's loss.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.calibration.lamps.ball import Array, Ball
from hagoromo.calibration.lamps.core import core_of
from hagoromo.calibration.lamps.lamp_speck import NOTHING_KNOWN, LampSpeck, Surroundings, lamp_speck
from hagoromo.calibration.lamps.light_on_ball import BallShading
from hagoromo.errors import InputError
from hagoromo.least_squares.fit_status import scipy_status

LEVELS = (0.3, 0.5, 0.7)  # of the highlight's peak: thresholds of centroids; the middle one is used
LARGEST_SHARE = 0.05  # of the ball's disc that a highlight may cover; a wider one has no accurate centre
BRANCHES = 1.3  # times the area of its core: an image larger than that has streaks, or a scratch runs through it
AGREE = 2.0  # standard errors: two places that differ by less agree
ON_BODY = 0.1  # of the image's radius: standard error on a body, whose shading moves the brightest place
REACH, SMALLEST_REACH = 1.4, 1.5  # of the core's radius, and [px]: radius of its pixels
DISPUTES = {  # what has the lamp's image elsewhere
    "streaks": "the place where its streaks meet",
    "second": "another spot that is about as bright",
    "shading": "the shading of the ball",
}
RIVAL = 0.5  # score over the highlight's own: another spot of more may be the lamp
SMOOTHED = 0.8  # [px] standard deviation, under which slopes are taken
ASIDE = (4.0, 5.0, 6.5)  # [px] scale of the loss: some times what an edge passes the lamp by; the middle one is used
AROUND = 3  # [px] around the speck whose slopes count
STARTS, STEPS, SETTLED = 25, 40, 1e-3  # first guesses within the speck; of the iteration; [px]
FAINT = 0.01  # of the steepest slope: fainter ones are noise
ALIKE = 0.03  # least ratio of the two curvatures: streaks along one line meet anywhere
AS_GOOD = 1.1  # times the least cost: centres of less are as likely
RIM = 0.5  # of the lamp's radius: standard error, as edges of the lamp itself pass its centre by the radius
MARGIN = 3  # pixels around the speck
NEAREST, LARGEST = 6, 90  # [px] smallest area for an ellipse, and extent above which the centroid is accurate
POOR = 0.06  # of the peak: largest rms residual of a speck that is an ellipse
ELLIPSE_STEPS = 200  # largest number of evaluations of the fit
ASTRAY = 0.6  # [px] largest distance of the centre from the centroid
FLOOR = 0.03  # [px] standard error of the best fit, for lamps that are not quite ellipses


@dataclass(frozen=True, eq=False)
class Highlight:
    """The lamp's mirror image: centre (x, y) [px], its standard error [px], size [px²], rival's score over its own.

    points: (n, 2) [px] of its pixels above the lowest level, weights: (levels, n) of their light. source: "ellipse",
    "core", "core and streaks", or "shading" where the ball shows no highlight. disputed: another place (x, y) [px] that
    may be the lamp's, which the error holds, and what says so, of DISPUTES; None and "" without one. on_body: whether
    the ball is no mirror.
    """

    centre: tuple[float, float]
    standard_error: float
    pixels: int
    rival: float
    points: Array
    weights: Array
    source: str = "ellipse"
    disputed: tuple[float, float] | None = None
    dispute: str = ""
    on_body: bool = False


class _Place(NamedTuple):
    """centre (2,), its standard error [px], radius of its pixels [px]; where it is from; another place, and why."""

    centre: Array
    error: float
    reach: float
    source: str
    other: Array | None = None
    dispute: str = ""


def find_highlight(
    photograph: NDArray, ball: Ball, known: Surroundings = NOTHING_KNOWN, shading: BallShading | None = None
) -> Highlight:
    """The lamp's mirror image on the ball.

    photograph: (height, width[, channels]) integers, or light as floats, NaN where it is clipped or unknown. known:
    what the other photographs show. shading: of the ball in this one, if it is no mirror. `InputError` where nothing
    stands out of the ball's light, or what does is too wide.
    """
    seen = lamp_speck(photograph, ball, known, shading)
    pixels = int(seen.speck.sum())
    if pixels > LARGEST_SHARE * seen.share:
        raise InputError(f"the highlight covers {pixels} pixels of the ball: expose shorter, focus, or use a mirror")
    place = _beside_rival(_place(seen), seen)
    corner = seen.corner[::-1]
    weights = np.stack([_weight(seen, level) for level in LEVELS])
    rows, columns = np.nonzero(weights.any(axis=0))
    points, weights = np.stack([columns, rows], axis=1) + np.float64(0.5), weights[:, rows, columns]
    if place.source != "ellipse":
        near = np.hypot(*(points - place.centre).T) < place.reach
        points, weights = points[near], np.ones((len(LEVELS), int(near.sum())))
    centroid = weights[1] @ points / weights[1].sum()
    points = points + (place.centre - centroid) + corner
    x, y = (place.centre + corner).tolist()
    other = None if place.other is None else (float(place.other[0] + corner[0]), float(place.other[1] + corner[1]))
    on_body = shading is not None
    error = float(np.hypot(place.error, on_body * ON_BODY * np.sqrt(pixels / np.pi)))
    return Highlight(
        (x, y), error, pixels, seen.rival, points, weights, place.source, other, place.dispute, on_body
    )  # fmt: skip


def _place(seen: LampSpeck) -> _Place:
    """The place of the lamp in its image, in the box of `seen`."""
    core = core_of(seen.light, seen.speck)
    reach = max(REACH * core.radius, SMALLEST_REACH)
    ellipse = ellipse_centre(seen.light, seen.speck)
    if ellipse is not None:
        return _Place(np.array([ellipse.x, ellipse.y]), ellipse.standard_error, reach, "ellipse")
    alone = _Place(core.centre, core.standard_error, reach, "core")
    meeting = where_streaks_meet(seen.light, seen.speck, core.radius) if core.branching > BRANCHES else None
    if meeting is None:
        return alone
    apart, both = float(np.hypot(*(meeting.place - core.centre))), float(np.hypot(meeting.error, core.standard_error))
    if apart > AGREE * both:  # streaks are wrong more often
        error = float(np.hypot(core.standard_error, 0.5 * apart))
        return alone._replace(error=error, other=meeting.place, dispute="streaks")
    share = (core.standard_error / both) ** 2
    centre = (1.0 - share) * core.centre + share * meeting.place
    return _Place(centre, core.standard_error * meeting.error / both, reach, "core and streaks")


def _beside_rival(place: _Place, seen: LampSpeck) -> _Place:
    """The place, with an error that holds another spot, if that is about as bright."""
    if seen.rival < RIVAL:
        return place
    other = np.asarray(seen.rival_place, np.float64) - seen.corner[::-1]
    error = float(np.hypot(place.error, 0.5 * np.hypot(*(other - place.centre))))
    return place._replace(error=error, other=other, dispute="second")


def _weight(seen: LampSpeck, level: float) -> Array:
    from skimage.measure import label

    parts = np.asarray(label(seen.light > level, connectivity=1))
    mine = np.bincount(parts[seen.speck], minlength=2)
    mine[0] = 0
    return np.where(parts == mine.argmax(), seen.light - 0.5 * level, 0.0)


class Meeting(NamedTuple):
    """place (x, y) where streaks meet, and its standard error [px]."""

    place: Array
    error: float


def where_streaks_meet(light: Array, speck: NDArray[np.bool_], radius: float = 0.0) -> Meeting | None:
    """Where the streaks of the speck meet; None where they do not cross.

    radius: of the lamp's image [px]. The error holds the range over scales, and over centres of about the same cost.
    """
    from scipy.ndimage import binary_dilation, gaussian_filter1d

    near = np.asarray(binary_dilation(speck, iterations=AROUND), np.bool_) & (light > 0.0)
    smooth = [gaussian_filter1d(light, SMOOTHED, axis=axis) for axis in (0, 1)]
    slopes = [
        gaussian_filter1d(one, SMOOTHED, axis=axis, order=1)[near] for axis, one in zip((1, 0), smooth, strict=True)
    ]
    slope = np.stack(slopes, axis=1).astype(np.float64)
    steep = np.linalg.norm(slope, axis=1)
    kept = steep > FAINT * steep.max()
    points, slope = (np.argwhere(near)[:, ::-1] + 0.5)[kept].astype(np.float64), slope[kept]
    inside = (np.argwhere(speck)[:, ::-1] + 0.5).astype(np.float64)
    starts = inside[np.unique(np.linspace(0, len(inside) - 1, STARTS).astype(int))]
    centres, scatter = [], []
    for scale in ASIDE:
        found = [_settled(points, slope, start, scale) for start in starts]
        centre, least, ratio = min(found, key=lambda one: one[1])
        if ratio < ALIKE:
            return None
        centres.append(centre)
        as_good = np.array([one[0] for one in found if one[1] < AS_GOOD * least])
        scatter.append(np.sqrt(np.mean(np.sum((as_good - centre) ** 2, axis=1))))
    parts = float(np.ptp(centres, axis=0).max()), float(max(scatter)), RIM * radius
    return Meeting(centres[len(centres) // 2], float(np.hypot.reduce(parts)))


def _settled(points: Array, slope: Array, start: Array, scale: float) -> tuple[Array, float, float]:
    """The centre from `start` on, its cost, and the ratio of its curvatures."""
    centre, squared = start, np.sum(slope**2, axis=1)
    normal, ratio = np.eye(2), 1.0
    for _ in range(STEPS):
        off = np.sum((points - centre) * slope, axis=1) ** 2 / squared / scale**2
        weighed = slope / (1.0 + off)[:, None]
        normal = weighed.T @ slope
        low, high = np.linalg.eigvalsh(normal)
        ratio = float(low / high)
        if ratio < 1e-9:
            break
        after = np.linalg.solve(normal, weighed.T @ np.sum(slope * points, axis=1))
        step, centre = np.hypot(*(after - centre)), after
        if step < SETTLED:
            break
    off = np.sum((points - centre) * slope, axis=1) ** 2 / squared / scale**2
    return centre, float(squared @ np.log1p(off)), ratio


class Centre(NamedTuple):
    """Centre of an ellipse: x, y [px], and their standard error [px]."""

    x: float
    y: float
    standard_error: float


def ellipse_centre(light: Array, speck: NDArray[np.bool_]) -> Centre | None:
    """The centre of the ellipse in `light` (height, width; its peak is 1) that covers `speck`; None if none fits.

    None also if the fit does not converge: the highlight's centroid is then used, with its own error.
    """
    from scipy.optimize import least_squares
    from scipy.special import ndtr

    rows, columns = np.nonzero(speck)
    if len(rows) < NEAREST or max(np.ptp(rows), np.ptp(columns)) > LARGEST:
        return None
    box = tuple(
        slice(max(int(i.min()) - MARGIN, 0), min(int(i.max()) + MARGIN + 1, size))
        for i, size in zip((rows, columns), light.shape, strict=True)
    )
    window = light[box]
    y, x = np.mgrid[box] + 0.5
    middle = np.array([columns.mean(), rows.mean()]) + 0.5

    def model(parameters: Array) -> Array:
        # (cx, cy), root of the ellipse's matrix [1/px], ln of the unclipped light, ln of the blur [px], background
        u, v = x - parameters[0], y - parameters[1]
        p, q = parameters[2] * u + parameters[3] * v, parameters[3] * u + parameters[4] * v
        rho = np.hypot(p, q) + 1e-9
        slope = np.hypot(parameters[2] * p + parameters[3] * q, parameters[3] * p + parameters[4] * q) / rho + 1e-9
        inside = ndtr((1.0 - rho) / slope / np.hypot(np.exp(parameters[6]), 1.0 / np.sqrt(12.0)))
        return np.minimum(parameters[7] + np.exp(parameters[5]) * inside, 1.0)

    spread = np.linalg.inv(np.cov(np.stack([columns, rows])) + np.eye(2) / 12.0)
    values, axes = np.linalg.eigh(spread)
    root = axes @ np.diag(0.5 * np.sqrt(values)) @ axes.T  # a disc's second moment is a quarter of its radius squared
    start = np.r_[middle, root[0, 0], root[0, 1], root[1, 1], np.log(3.0), np.log(0.5), np.median(window)]
    fit = least_squares(
        lambda parameters: (model(parameters) - window).ravel(),
        start,
        loss="soft_l1",
        f_scale=0.03,
        max_nfev=ELLIPSE_STEPS,
    )
    if not scipy_status(fit).converged:
        return None
    rms = float(np.sqrt(np.mean((model(fit.x) - window) ** 2)))
    if not rms < POOR or not np.hypot(*(fit.x[:2] - middle)) < ASTRAY:
        return None
    covariance = np.linalg.pinv(fit.jac.T @ fit.jac)[:2, :2] * rms**2
    return Centre(float(fit.x[0]), float(fit.x[1]), float(np.hypot(np.sqrt(np.trace(covariance) / 2.0), FLOOR)))
