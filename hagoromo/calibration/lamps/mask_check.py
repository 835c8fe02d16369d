"""Mask check: whether the photographs show the ball's outline where the mask has it, or elsewhere.

A mask beside the ball gives wrong lamps without a sign of it. Where the photographs do not confirm its edge, circles
around it are tried: of each, the share of its outline that is an edge in the photographs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.calibration.lamps.ball import MASK_ERROR, PARTLY, Array, Ball, fit_ball, grey, stated
from hagoromo.calibration.lamps.light_on_ball import Light
from hagoromo.calibration.lamps.outline import edge_shown, edges_on_rays, refined
from hagoromo.errors import InputError

BESIDE = 0.1  # of the radius: an outline that is farther off is not the mask's
FINE = 64.0  # [px] radius of the ball in the reduced photographs, at most
APART, SIZES = 0.6, (0.75, 1.3)  # of the mask's radius: centres and radii of circles that are tried
INWARD, ON_RAY, FEWEST = 0.3, 4, 12  # of the radius: where rays begin; edges of a ray, from outside; of all
TRIPLES, ON_CIRCLE, SAME = 2000, 1.0, 3.0  # circles that are drawn; [px] from one that an edge is on it; that are one
TRIED, HOPELESS, ROUNDS = 6, 0.15, 2  # circles that are looked at closely; share, and times that each is moved to it
CONFIRMED = 0.5  # share of an outline that is an edge, from which it is a ball's
MORE = 0.25  # by which this share exceeds the mask's where the ball is beside the mask


class ShownCircle(NamedTuple):
    """circle: around a ball, of whose outline the photographs show most; the share that they show; that of the ball."""

    circle: Ball
    share: float
    own: float


def confirmed(painted: Ball, photographs: Mapping[str, NDArray]) -> Ball:
    """The ball of a mask whose edge the photographs do not show all around; with the outline near it that they show.

    `InputError` where they show it beside the mask. `edge_share` is how much of its outline they show.
    """
    if painted.source != "mask":
        return painted
    shown = outline_around(painted, photographs)
    if shown.share < max(CONFIRMED, shown.own + MORE):
        return replace(painted, edge_share=shown.own)
    apart = _apart(shown.circle, painted)
    if apart > BESIDE * painted.radius:
        raise InputError(
            f"the mask is not where the photographs show the ball: {100 * shown.own:.0f} % of its edge is an edge in "
            f"them, and {100 * shown.share:.0f} % of that of a circle {apart:.0f} px off it: paint the mask anew, or "
            f"give that circle in place of the mask ({stated(shown.circle)})"
        )
    finer = refined(shown.circle, photographs.values())
    x, y = np.subtract(finer.centre, painted.centre).tolist()
    return replace(finer, from_mask=(x, y), edge_share=shown.share)


def outline_around(ball: Ball, photographs: Mapping[str, NDArray]) -> ShownCircle:
    """The outline around `ball` that the photographs show; each is read once."""
    scale = min(FINE / ball.radius, 1.0)
    pictures, corner = _around(ball, photographs, scale)
    here = fit_ball((ball.outline(90) - corner) * scale, None, MASK_ERROR)
    own = edge_shown(here, pictures)[1]
    if own >= CONFIRMED:
        return ShownCircle(ball, own, own)
    found, share = _sought(here, pictures)
    circle = fit_ball(found.outline(90) / scale + corner, ball.camera, MASK_ERROR)
    return ShownCircle(replace(circle, standard_error=(PARTLY * circle.radius,) * 3), share, own)


def _around(ball: Ball, photographs: Mapping[str, NDArray], scale: float) -> tuple[list[Light], Array]:
    """The photographs around the ball, reduced by `scale`, and the corner (x, y) [px] of the part that is shown."""
    import cv2

    reach = (1.0 + APART + SIZES[1] - 1.0 + 0.3) * ball.radius
    about = ball.outline(90).mean(axis=0)
    pictures, corner = [], np.zeros(2)
    for photograph in photographs.values():
        first = np.maximum(np.floor(about - reach), 0).astype(int)
        last = np.minimum(np.ceil(about + reach), photograph.shape[1::-1]).astype(int)
        part = np.nan_to_num(grey(photograph[first[1] : last[1], first[0] : last[0]]), posinf=0.0, neginf=0.0)
        size = [max(round(float(side) * scale), 1) for side in last - first]
        small = cv2.resize(part.astype(np.float32), size, interpolation=cv2.INTER_AREA) if scale < 1.0 else part
        pictures.append(np.asarray(small, np.float32))
        corner = first.astype(np.float64)
    return pictures, corner


def _sought(painted: Ball, pictures: Sequence[Light]) -> tuple[Ball, float]:
    """The circle around the mask of whose outline the pictures show most, and the share that they show."""
    best, most = painted, 0.0
    for circle in _circles(painted, pictures):
        circle, share = edge_shown(circle, pictures)
        for _ in range(ROUNDS if share > HOPELESS else 0):
            circle, share = edge_shown(circle, pictures)
        if share > most and SIZES[0] < circle.radius / painted.radius < SIZES[1]:
            best, most = circle, share
    return best, most


def _circles(painted: Ball, pictures: Sequence[Light]) -> list[Ball]:
    """The circles on which most rays from the mask's centre have an edge: of those through three edges, by chance."""
    rays = edges_on_rays(painted, pictures, INWARD, APART + SIZES[1], ON_RAY)  # (rays, ON_RAY, 2)
    shown = np.isfinite(rays[..., 0])
    if shown[:, 0].sum() < FEWEST:
        return []
    random = np.random.default_rng(0)
    drawn = [points[random.integers(0, len(points), (TRIPLES, 3))] for points in (rays[shown[:, 0], 0], rays[shown])]
    centres, radii = _through(np.concatenate(drawn))
    middle = painted.outline(90).mean(axis=0)
    near = (radii > SIZES[0] * painted.radius) & (radii < SIZES[1] * painted.radius)
    near &= np.hypot(*(centres - middle).T) < APART * painted.radius
    centres, radii = centres[near], radii[near]
    away = np.hypot(rays[..., 0] - centres[:, None, None, 0], rays[..., 1] - centres[:, None, None, 1])
    shares = (np.abs(away - radii[:, None, None]) < ON_CIRCLE).any(axis=2).mean(axis=1)
    chosen: list[Ball] = []
    for k in np.argsort(-shares, kind="stable"):
        circle = _circle(centres[k], float(radii[k]))
        if all(_apart(circle, one) > SAME for one in chosen):
            chosen.append(circle)
        if len(chosen) == TRIED:
            break
    return chosen


def _through(triples: Array) -> tuple[Array, Array]:
    """Centres (n, 2) and radii (n,) of the circles through three points each (n, 3, 2); NaN where they lie in line."""
    one, two, three = np.moveaxis(triples, 1, 0)
    a, b = two - one, three - one
    twice = 2.0 * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    twice = np.where(np.abs(twice) < 1e-6, np.nan, twice)
    aa, bb = np.sum(a * a, axis=1), np.sum(b * b, axis=1)
    off = np.stack([b[:, 1] * aa - a[:, 1] * bb, a[:, 0] * bb - b[:, 0] * aa], axis=1) / twice[:, None]
    return one + off, np.hypot(*off.T)


def _circle(centre: Array, radius: float) -> Ball:
    turn = 2.0 * np.pi * np.arange(90) / 90
    return fit_ball(centre + radius * np.stack([np.cos(turn), np.sin(turn)], axis=1), None, MASK_ERROR)


def _apart(one: Ball, other: Ball) -> float:
    """[px] between two outlines, at most."""
    return float(np.hypot(*np.subtract(one.centre, other.centre))) + abs(one.radius - other.radius)
