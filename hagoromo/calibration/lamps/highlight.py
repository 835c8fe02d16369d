"""Highlight: where a ball shows the image of a lamp.

An image that is an ellipse, blurred and clipped, is located by fitting one. Streaks of glare and scratches make it
something else: then its widest part is the lamp, and the place where its streaks meet is heard where both agree.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.calibration.lamps.ball import Array, Ball
from hagoromo.calibration.lamps.core import core_of
from hagoromo.calibration.lamps.lamp_speck import NOTHING_KNOWN, LampSpeck, Surroundings, lamp_speck
from hagoromo.calibration.lamps.shading import BallShading
from hagoromo.calibration.lamps.speck import ellipse_centre
from hagoromo.calibration.lamps.streaks import where_streaks_meet
from hagoromo.errors import InputError

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
    what the other photographs tell. shading: of the ball in this one, if it is no mirror. `InputError` where nothing
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
    other = np.array(seen.rival_place) - seen.corner[::-1]
    error = float(np.hypot(place.error, 0.5 * np.hypot(*(other - place.centre))))
    return place._replace(error=error, other=other, dispute="second")


def _weight(seen: LampSpeck, level: float) -> Array:
    from skimage.measure import label

    parts = np.asarray(label(seen.light > level, connectivity=1))
    mine = np.bincount(parts[seen.speck], minlength=2)
    mine[0] = 0
    return np.where(parts == mine.argmax(), seen.light - 0.5 * level, 0.0)
