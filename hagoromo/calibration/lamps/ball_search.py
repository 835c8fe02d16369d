"""Ball search: chrome balls in photographs with one lamp on in each, without a mask.

OpenCV proposes circles (Hough transform) in pictures of the mean, the greatest and the spread of the light over the
lamps. A circle is a mirror ball if its edge shows all around in the photographs, and each photograph shows on it the
small bright image of a lamp, in another place under another lamp.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from hagoromo.calibration.lamps.ball import Array, Ball, fit_ball, grey, stated
from hagoromo.calibration.lamps.highlight import LARGEST_SHARE
from hagoromo.calibration.lamps.lamp_speck import lamp_speck
from hagoromo.calibration.lamps.mask_check import outline_around
from hagoromo.calibration.lamps.outline import refined
from hagoromo.calibration.opencv_threads import one_thread
from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError
from hagoromo.progress import Progress, silent

SIDES = (640, 1600)  # [px] of the longer side of the pictures in which circles are sought, and then refined
FEWEST_LAMPS = 4  # with fewer, another bright spot may be taken for a lamp's image
LEAST_RADIUS, LARGEST_RADIUS = 9.0, 0.5  # [px] of the smaller pictures; of their shorter side
CIRCLES = 12  # proposals taken from each picture, the strongest first
COARSE, CANNY, VOTES = 1.5, 60.0, 14.0  # of OpenCV's transform: size of a cell [px], gradient of an edge, votes
MIRRORED = 0.9  # share of the photographs that show a lamp's image on a ball
TRIED = 8  # photographs in which all proposals are tried, before the rest
BRIGHT = 0.25  # of white, above the surroundings: a lamp's image is brighter
SMALLEST_SPECK = 4  # pixels that a lamp's image may always have
INSIDE = 0.97  # of the radius: a lamp's image is not on the outline
MOVES = 0.05  # of the radius: standard deviation of the places of the images, at least
LIKELY = 3  # circles in doubt that are looked at closely
SAME = 0.5  # of the radius: centres nearer than this are of one ball
FROM_EDGE = 1.0  # [px] error of a proposed outline, after its refinement in the larger pictures
PAINT = "paint a mask that is white on the ball, and give it in place of auto (--ball, --mask)"
OFFERED = "if that is the ball give it in place of auto"


@dataclass(frozen=True, eq=False)
class _Pictures:
    """The photographs, reduced, as 8 bits: scale is their size over that of the photographs."""

    shown: Sequence[NDArray[np.uint8]]
    scale: float
    camera: Camera | None


@dataclass(frozen=True, eq=False)
class _MirrorBalls:
    """Circles that mirror lamps in the photographs: those whose outline shows all around, and the others."""

    certain: list[Ball]
    doubtful: list[Ball]


def search_balls(
    photographs: Mapping[str, NDArray], camera: Camera | None = None, progress: Progress = silent
) -> list[Ball]:
    """The chrome balls in the photographs, the largest first, their outlines to about a pixel: `refined` finishes them.

    photographs: as `lamps_from_ball`; each is read once. `InputError` where no circle is a mirror ball beyond doubt: it
    offers the one that may be.
    """
    if len(photographs) < FEWEST_LAMPS:
        raise InputError(
            f"a chrome ball is found by {FEWEST_LAMPS} lamps or more, and {len(photographs)} are given: {PAINT}"
        )
    balls = _mirror_balls(photographs, camera, progress)
    if balls.certain:
        return balls.certain
    nothing = "no chrome ball stands out in the photographs"
    if not balls.doubtful:
        raise InputError(f"{nothing}: {PAINT}")
    around = [outline_around(ball, photographs) for ball in balls.doubtful[:LIKELY]]
    likely = max(around, key=lambda shown: shown.share).circle
    x, y = likely.centre
    raise InputError(
        f"{nothing} (a circle of {likely.radius:.0f} px radius at ({x:.0f}, {y:.0f}) shows the lamps, but its outline "
        f"does not show all around): {OFFERED} ({stated(likely)}), else {PAINT}"
    )


def _mirror_balls(
    photographs: Mapping[str, NDArray], camera: Camera | None = None, progress: Progress = silent
) -> _MirrorBalls:
    """Circles that mirror a lamp in each photograph, in places that differ; the largest certain one first."""
    small, large, shape = _reduced(photographs, camera, progress)
    with one_thread():
        proposed = _proposed(small)
    certain: list[Ball] = []
    doubtful: list[Ball] = []
    for ball in proposed:
        if any(_is_same(ball, other) for other in certain) or not _mirrors(ball, small.shown[:: _step(small)]):
            continue
        finer = _edged(ball, small, large)
        (doubtful if finer is None else certain).append(ball if finer is None else finer)
    known, likely = (
        [ball for ball in (_scaled(one, 1.0 / small.scale, camera) for one in some) if ball.is_within(shape)]
        for some in (certain, doubtful)
    )
    return _MirrorBalls(sorted(known, key=lambda ball: -ball.radius), likely)


def _edged(ball: Ball, small: _Pictures, large: _Pictures) -> Ball | None:
    """The ball in the small pictures with the outline that both sizes show all around; None where they do not."""
    edged = refined(ball, small.shown)
    if edged.source != "photographs" or not _mirrors(edged, small.shown):
        return None
    if large.scale == small.scale:
        return edged
    edged = refined(_scaled(edged, large.scale / small.scale, large.camera), large.shown)
    return _scaled(edged, small.scale / large.scale, small.camera) if edged.source == "photographs" else None


def _reduced(
    photographs: Mapping[str, NDArray], camera: Camera | None, progress: Progress
) -> tuple[_Pictures, _Pictures, tuple[int, int]]:
    """The photographs in two sizes, and their own."""
    import cv2

    sizes: list[list[NDArray[np.uint8]]] = [[] for _ in SIDES]
    shape, scales = (0, 0), [1.0 for _ in SIDES]
    for number, (name, photograph) in enumerate(photographs.items()):
        if number and photograph.shape[:2] != shape:
            raise InputError(f"{name} is {photograph.shape[:2]} pixels and the first {shape}: give them one size")
        shape = photograph.shape[0], photograph.shape[1]
        white = float(np.iinfo(photograph.dtype).max) if photograph.dtype.kind in "ui" else None
        light = grey(photograph).astype(np.float32)
        if white is None:
            known = light[np.isfinite(light)]
            white = max(float(known.max(initial=0.0)), 1e-30)
            light = np.where(np.isfinite(light), light, np.float32(white))
        for k, side in enumerate(SIDES):
            scales[k] = min(side / max(shape), 1.0)
            size = max(round(shape[1] * scales[k]), 1), max(round(shape[0] * scales[k]), 1)
            reduced = cv2.resize(light, size, interpolation=cv2.INTER_AREA) if scales[k] < 1.0 else light
            sizes[k].append(np.rint(np.clip(np.asarray(reduced) * (255.0 / white), 0.0, 255.0)).astype(np.uint8))
        progress(0.5 * (number + 1) / len(photographs), name)
    small, large = (
        _Pictures(shown, scale, None if camera is None else _reduced_camera(camera, scale, shown[0].shape))
        for shown, scale in zip(sizes, scales, strict=True)
    )
    return small, large, shape


def _proposed(pictures: _Pictures) -> list[Ball]:
    """Circles that OpenCV finds in pictures of the light over the lamps, as balls."""
    import cv2

    every = np.stack(pictures.shown).astype(np.float32)
    mean, height, width = every.mean(axis=0), *every.shape[1:]
    found: list[Ball] = []
    for picture in (np.sqrt(mean), np.sqrt(every.max(axis=0)), np.sqrt(every.std(axis=0)), np.sqrt(every.min(axis=0))):
        low, high = np.percentile(picture, [1.0, 99.0])
        shown = np.clip((picture - low) * (255.0 / max(float(high - low), 1e-6)), 0.0, 255.0).astype(np.uint8)
        smooth = cv2.GaussianBlur(cv2.medianBlur(shown, 5), (0, 0), 1.0)  # noise has edges, too, and they vote
        circles = cv2.HoughCircles(
            smooth, cv2.HOUGH_GRADIENT, COARSE, LEAST_RADIUS, param1=CANNY, param2=VOTES,
            minRadius=int(LEAST_RADIUS), maxRadius=int(LARGEST_RADIUS * min(height, width)),
        )  # fmt: skip
        if circles is None:
            continue
        for x, y, radius in np.asarray(circles, np.float64).reshape(-1, 3)[:CIRCLES]:
            if radius < x < width - radius and radius < y < height - radius:
                found.append(_ball_of((x + 0.5, y + 0.5), radius, pictures.camera))
    return found


def _mirrors(ball: Ball, shown: Sequence[NDArray[np.uint8]]) -> bool:
    """Whether the photographs show lamps on the ball, in places that differ."""
    places = []
    for picture in shown:
        try:
            seen = lamp_speck(picture, ball)
        except InputError:
            continue
        if seen.peak > BRIGHT and seen.speck.sum() <= max(LARGEST_SHARE * seen.share, SMALLEST_SPECK):
            rows, columns = np.nonzero(seen.speck)
            places.append((columns.mean() + seen.corner[1] + 0.5, rows.mean() + seen.corner[0] + 0.5))
    if len(places) < max(MIRRORED * len(shown), 3):
        return False
    off = (np.array(places) - ball.centre) / ball.radius
    inside = np.hypot(*off.T) < INSIDE
    moved = [np.hypot(x, y) for x, y in (np.subtract(one, other) for one, other in pairwise(off))]
    return bool(inside.mean() >= MIRRORED and np.std(off, axis=0).max() > MOVES and np.median(moved) > MOVES)


def _step(pictures: _Pictures) -> int:
    return max(len(pictures.shown) // TRIED, 1)


def _is_same(ball: Ball, other: Ball) -> bool:
    return float(np.hypot(*np.subtract(ball.centre, other.centre))) < SAME * max(ball.radius, other.radius)


def _ball_of(centre: tuple[float, float], radius: float, camera: Camera | None) -> Ball:
    turn = 2.0 * np.pi * np.arange(64) / 64
    edge = np.array(centre) + radius * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    return fit_ball(edge, camera, FROM_EDGE, "search")


def _scaled(ball: Ball, factor: float, camera: Camera | None) -> Ball:
    """The ball in pictures `factor` times as large."""
    edge: Array = ball.outline(90) * factor
    return fit_ball(edge, camera, FROM_EDGE, "search")


def _reduced_camera(camera: Camera, scale: float, shape: tuple[int, ...]) -> Camera:
    return camera.resampled(shape[1], shape[0], (1.0 / scale, 1.0 / scale))
