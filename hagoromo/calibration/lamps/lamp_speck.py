"""Lamp speck: which bright spot on a ball is the image of the lamp.

It is the brightest of those that stand out of their surroundings and do not stay where they are while other lamps are
on; among spots of one brightness, that whose light is most within a small disc: scratches are thinner.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.calibration.lamps.ball import Array, Ball
from hagoromo.calibration.lamps.light_on_ball import (
    FINE_BLUR,
    BallShading,
    Light,
    LightOnBall,
    above_shading,
    above_surroundings,
    blurred,
    light_on_ball,
    unevenness,
)
from hagoromo.errors import InputError

HALF = 0.5  # of the peak: pixels above are the speck
STANDS_OUT = 8.0  # smallest ratio of the blurred peak to the unevenness of the ball
DIMMEST = 0.03  # of white, smallest peak of stored numbers
CONTRAST = 3.0  # smallest ratio of the peak to the 90th percentile of the ball, both above the surroundings
FLAT_FALL = 0.05  # of the score: a smaller fall is none
FLAT = 0.98  # of the peak: light above it is clipped, or nearly
STEEP = 3  # power of the light in the score, so that brightness counts more than area
THINNER, BESIDE = 0.4, 3.0  # share of the score that a line loses; distance [discs] at which a spot is compared
DISC = 0.02, 1.2  # of the radius, and [px] at least: standard deviation of the disc in which light counts
SPILT = 0.02  # of a speck that is blurred: where its light counts
LEFT = 0.25  # of the peak: what is left beside what stands still, at least, or nothing is taken as still


@dataclass(frozen=True, eq=False)
class Surroundings:
    """What all photographs of a ball show before one of them is read.

    still: (h, w) light [white] that stands out in every one, in the box whose corner is (row, column); None for few
    photographs. shadings: by name, of a ball that is no mirror.
    """

    still: Light | None = None
    corner: tuple[int, int] = (0, 0)
    shadings: Mapping[str, BallShading] = field(default_factory=dict)


NOTHING_KNOWN = Surroundings()


class LampSpeck(NamedTuple):
    """The speck on a ball that is the image of the lamp.

    light: (h, w) of the box around the ball, above the surroundings, over its peak; 0 beside the speck's place on a
    glossy ball. speck: (h, w) above half of the peak. peak [white]. rival: score of the next spot over its own, and its
    place (x, y) [px] in the picture. corner: (row, column) of the box. share: pixels of the ball.
    """

    light: Array
    speck: NDArray[np.bool_]
    peak: float
    rival: float
    rival_place: tuple[float, float]
    corner: NDArray[np.intp]
    share: int


def lamp_speck(
    photograph: NDArray, ball: Ball, known: Surroundings = NOTHING_KNOWN, shading: BallShading | None = None
) -> LampSpeck:
    """The lamp's image on the ball; `InputError` where nothing stands out as one does.

    shading: of the ball in this photograph, if it is no mirror.
    """
    seen = light_on_ball(photograph, ball)
    if shading is not None:
        return brightest_speck(seen, *above_shading(seen, ball, shading), ball.radius)
    above = above_surroundings(seen)
    return brightest_speck(seen, above, _moving(above, seen, known), ball.radius)


def brightest_speck(seen: LightOnBall, above: Light, likely: Light, radius: float) -> LampSpeck:
    """The speck of `likely`, which is `above` (h, w) [white] where the lamp may be, on a ball of `radius` [px].

    `InputError` where nothing stands out.
    """
    from skimage.measure import label

    peak, usual = float(likely.max()), float(np.percentile(likely[seen.on], 90))
    noise = float(blurred(likely, FINE_BLUR).max()) < STANDS_OUT * max(unevenness(seen), 0.5 * seen.least)
    if noise or peak < max(DIMMEST * (seen.least > 0.0), CONTRAST * usual) or peak <= 0.0:
        raise InputError(
            f"no highlight on the ball (the brightest spot is {peak:.2g} of white above its surroundings): light it, "
            "or expose longer, or shorter where all is white"
        )
    disc = max(DISC[0] * radius, DISC[1])
    standing = likely > LEFT * peak
    score = blurred(likely * (seen.light / seen.light[standing].max()) ** STEEP, disc)
    score = score * (1.0 - THINNER + THINNER * roundness(score, max(round(BESIDE * disc), 2)))
    best = np.unravel_index(np.argmax(np.where(standing, score, 0.0)), score.shape)
    most = float(score[best])
    about = tuple(slice(max(int(at - 2.0 * disc), 0), int(at + 2.0 * disc) + 2) for at in best)
    top = float(likely[about].max())
    speck = _nearest(np.asarray(label(likely > HALF * top, connectivity=1)), best)
    rows, columns = np.ogrid[: score.shape[0], : score.shape[1]]
    far = np.hypot(rows - best[0], columns - best[1]) > 3.0 * disc + np.sqrt(speck.sum() / np.pi)
    far &= blurred(speck.astype(np.float32), disc) < SPILT
    rival = np.unravel_index(np.argmax(np.where(far, score, 0.0)), score.shape)
    x, y = seen.points(*(np.array([index]) for index in rival))[0].tolist()
    ratio = float(score[rival] / most) if far[rival] else 0.0
    top = float(above[speck].max())
    clipped = (seen.light > FLAT * float(seen.light[speck].max())) & (above > 0.0)
    light = np.where(clipped, 1.0, np.minimum(above / top, 1.0)).astype(np.float64)
    return LampSpeck(light, speck, top, ratio, (x, y), seen.corner, int(seen.on.sum()))


def roundness(score: Light, reach: int) -> Light:
    """(h, w) 1 where the score falls off alike in all directions within `reach` [px], 0 on a line, 1 where it is flat.

    Least over largest fall along four axes, as means to both sides.
    """
    padded = np.pad(score, reach)
    height, width = score.shape
    falls = []
    for right, down in ((1.0, 0.0), (0.707, 0.707), (0.0, 1.0), (-0.707, 0.707)):
        x, y = round(reach * right), round(reach * down)
        ahead, behind = (
            padded[reach + sign * y : reach + sign * y + height, reach + sign * x : reach + sign * x + width]
            for sign in (1, -1)
        )
        falls.append(score - 0.5 * (ahead + behind))
    least, largest = np.minimum.reduce(falls), np.maximum.reduce(falls)
    flat = largest < FLAT_FALL * score
    return np.where(flat, 1.0, np.clip(least / np.maximum(largest, 1e-30), 0.0, 1.0)).astype(np.float32)


def _nearest(specks: NDArray, place: tuple[np.intp, ...]) -> NDArray[np.bool_]:
    """The speck that is nearest to `place` (row, column)."""
    rows, columns = np.nonzero(specks)
    nearest = np.argmin((rows - place[0]) ** 2 + (columns - place[1]) ** 2)
    return specks == specks[rows[nearest], columns[nearest]]


def _moving(above: Light, seen: LightOnBall, known: Surroundings) -> Light:
    """`above`, less what stands still; as it is where nothing else would be left."""
    if known.still is None:
        return above
    first = np.maximum(seen.corner, known.corner)
    last = np.minimum(seen.corner + above.shape, np.add(known.corner, known.still.shape))
    here, there = (
        tuple(slice(low, high) for low, high in zip(first - corner, last - corner, strict=True))
        for corner in (seen.corner, np.array(known.corner))
    )
    moving = above.copy()
    moving[here] = np.maximum(above[here] - known.still[there], 0.0)
    return moving if moving.max() > LEFT * above.max() else above
