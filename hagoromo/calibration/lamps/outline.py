"""Outline: the ball's edge from the photographs, more accurate than a mask, and its sharpness.

Along rays from the ball's centre the light changes at the edge, to brighter or darker, in some of the photographs.
Where the change is significant all around, its position replaces the mask's edge; else the mask's edge is used.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hagoromo.calibration.lamps.ball import Array, Ball, fit_ball, grey
from hagoromo.errors import InputError

SECTORS, RAYS = 90, 5  # sectors of the circle, and profiles that are averaged in each
STEP = 0.25  # [px] between samples of a profile
NEAR = 2.5  # [px] search range on either side of the mask's edge
FAR = 0.12  # of the radius: range on either side of the edge in which its blur is measured
SMOOTH = 0.7  # [px] standard deviation of the smoothing of profiles
NARROWEST = 0.8  # [px] standard deviation of the edge of a sharp disc, after sampling and smoothing
FOOT = 0.2  # of the change at the edge: where its peak ends
CLEAR = 6.0  # ratio of the change at the edge to the usual change beside the ball, above which it is significant
ENOUGH = 0.6  # smallest share of the sectors with a significant edge
CONSISTENT = 0.5  # [px] rms deviation from a ball's outline up to which the edge is the ball's
AFAR, USUAL, STANDS_OUT = 0.3, 95.0, 3.0  # [radii] outside of a mask; percentile of changes there; times it: an edge
FEW, ON_EDGE = 9, 0.7  # sectors with an edge that a circle needs; [px] from it that an edge is on it
EDGE_ERROR = 0.2  # [px] systematic error of the radius, due to reflections that crowd at the edge
PAINTED, SHOWN = 0.29, 0.2  # [px] standard errors of the centre by a mask, and by photographs, beside their scatter
UNSEEN = 0.004  # of the radius: standard error of a painted outline that the photographs do not show
DISPUTED = 0.5  # standard error per difference from the mask's circle, beyond the size of its pixels
STRONG = 0.05  # of the strongest change near the edge: the outermost change above this is the edge
BLURRED = 0.04  # of the radius: standard deviation of the blur above which the ball is out of focus


def refined(ball: Ball, photographs: Iterable[NDArray]) -> Ball:
    """The ball with the blur of its edge and, where they show it better, its outline from `photographs`.

    photographs: (height, width[, channels]) each.
    """
    change, steps, offsets, clear = _near(ball, photographs)
    softness = _softness(change[:, clear], offsets[clear], steps) if clear.mean() >= ENOUGH else None
    if clear.mean() < ENOUGH:
        return _unseen(ball, softness)
    sectors = np.flatnonzero(clear)
    edge = np.stack([ball.outline(SECTORS, 1.0 + offsets[i] / ball.radius)[i] for i in sectors])
    finer = fit_ball(edge, ball.camera, EDGE_ERROR, "photographs")
    consistent = np.hypot(*(edge - finer.outline(SECTORS)[sectors]).T) < 3.0 * CONSISTENT
    if consistent.mean() < ENOUGH or not _all_around(sectors[consistent]):
        return _unseen(ball, softness)
    finer = fit_ball(edge[consistent], ball.camera, EDGE_ERROR, "photographs")
    better = finer.rms < CONSISTENT and finer.standard_error[0] < max(ball.standard_error[2], EDGE_ERROR)
    if not better:
        return _unseen(ball, softness)
    if ball.source == "search":  # by circles in reduced pictures, which are no witness against the edge itself
        return replace(finer, softness=softness)
    return replace(_together(ball, finer), softness=softness)


def edge_shown(ball: Ball, photographs: Iterable[NDArray]) -> tuple[Ball, float]:
    """The ball through the edges that `photographs` show near its outline, and the share of its outline on them."""
    _, _, offsets, clear = _near(ball, photographs)
    sectors = np.flatnonzero(clear)
    if len(sectors) < FEW:
        return ball, 0.0
    edge = np.stack([ball.outline(SECTORS, 1.0 + offsets[i] / ball.radius)[i] for i in sectors])
    finer = fit_ball(edge, ball.camera, EDGE_ERROR, ball.source)
    on = np.hypot(*(edge - finer.outline(SECTORS)[sectors]).T) < ON_EDGE
    return finer, float(on.sum() / SECTORS)


def edges_on_rays(ball: Ball, photographs: Iterable[NDArray], first: float, last: float, most: int) -> Array:
    """(SECTORS, most, 2) edges [px] on rays from the ball's centre, the outermost first; NaN where there are fewer.

    first, last: of the radius, where the rays begin and end.
    """
    steps = np.arange((first - 1.0) * ball.radius, (last - 1.0) * ball.radius, STEP)
    strength = np.zeros((SECTORS, len(steps)))
    for photograph in photographs:
        change = np.abs(_changes(ball, photograph, steps))
        usual = float(np.percentile(change[:, steps > AFAR * ball.radius], USUAL))
        strength = np.maximum(strength, change / (usual + 1e-12 + 1e-3 * float(change.max())))
    middle = strength[:, 1:-1]
    peak = (middle >= strength[:, :-2]) & (middle > strength[:, 2:]) & (middle > STANDS_OUT)
    edges = np.full((SECTORS, most, 2), np.nan)
    for sector, on in enumerate(peak):
        found = np.flatnonzero(on)[::-1][:most] + 1
        edges[sector, : len(found)] = ball.outline(SECTORS, 1.0 + steps[found] / ball.radius)[:, sector]
    return edges


def _near(ball: Ball, photographs: Iterable[NDArray]) -> tuple[Array, Array, Array, NDArray[np.bool_]]:
    """Changes of light (K, SECTORS, T) at T steps [px] from the outline, and the steps; the offset [px] of the edge in
    each sector, and whether there is one.
    """
    reach = max(FAR * ball.radius, 3.0 * NEAR)
    steps = np.arange(-reach, 1.5 * reach, STEP)
    change = np.stack([_changes(ball, photograph, steps) for photograph in photographs])
    usual = np.median(np.abs(change[..., steps > reach]), axis=2, keepdims=True)  # beside the ball
    usual = usual + 1e-12 + 1e-3 * np.abs(change).max()
    energy = np.sum((change / usual) ** 2, axis=0)
    return change, steps, *_edges(energy, steps, CLEAR**2 + len(change))


def _together(painted: Ball, shown: Ball) -> Ball:
    """The outline that the photographs show, its centre averaged with that of the mask by their errors.

    Where the two disagree either may be wrong, as an edge of a reflection can look like the ball's.
    """
    x, y = apart = np.subtract(shown.centre, painted.centre)
    by_photographs = shown.standard_error[0] ** 2 + SHOWN**2
    share = by_photographs / (by_photographs + painted.standard_error[0] ** 2 + PAINTED**2)
    mean = fit_ball(shown.edge - share * apart, shown.camera, EDGE_ERROR, "photographs")
    centre = DISPUTED * float(np.hypot(x, y))
    radius = DISPUTED * max(abs(shown.radius - painted.radius) - 0.5, 0.0)
    errors = np.hypot(shown.standard_error, (centre, centre, radius)).tolist()
    return replace(mean, from_mask=(float(x), float(y)), standard_error=tuple(errors))


def _unseen(ball: Ball, softness: float | None) -> Ball:
    """The ball as it was given: with the error of a mask that is painted by hand."""
    if ball.source == "search":
        return replace(ball, softness=softness)
    errors = np.hypot(ball.standard_error, UNSEEN * ball.radius).tolist()
    return replace(ball, softness=softness, standard_error=tuple(errors))


def check_focus(ball: Ball) -> None:
    """Raise `InputError` when the photographs showed the ball out of focus."""
    if ball.softness is not None and ball.softness > BLURRED * ball.radius:
        raise InputError(
            f"the ball is out of focus: its edge is blurred by {ball.softness:.1f} px (standard deviation), "
            f"{100 * ball.softness / ball.radius:.0f} % of its radius: focus on the ball"
        )


def _all_around(sectors: NDArray[np.intp]) -> bool:
    """Whether half the sectors of every eighth of the circle are present: one side does not determine the centre."""
    return bool((np.bincount(sectors * 8 // SECTORS, minlength=8) >= 0.5 * SECTORS / 8).all())


def _changes(ball: Ball, photograph: NDArray, steps: Array) -> Array:
    """(SECTORS, T) derivative of the light outwards, at `steps` [px] from the edge."""
    from scipy.ndimage import gaussian_filter1d, map_coordinates

    ring = ball.outline(SECTORS * RAYS, 1.0 + steps / ball.radius)  # (T, SECTORS · RAYS, 2)
    picture = np.nan_to_num(grey(photograph), posinf=0.0, neginf=0.0)
    light = map_coordinates(picture, (ring - 0.5)[..., ::-1].transpose(2, 0, 1), order=1, mode="nearest")
    around = np.roll(light, RAYS // 2, axis=1).reshape(len(steps), SECTORS, RAYS).mean(axis=2)
    return gaussian_filter1d(around, SMOOTH / STEP, axis=0, order=1).T


def _edges(energy: Array, steps: Array, least: float) -> tuple[Array, NDArray[np.bool_]]:
    """Position [px] of the outermost strong change near the mask's edge in each sector, and whether there is one."""
    near = np.flatnonzero(np.abs(steps) <= NEAR)
    part = energy[:, near]
    peak = (part[:, 1:-1] >= part[:, :-2]) & (part[:, 1:-1] >= part[:, 2:])
    strong = peak & (part[:, 1:-1] > np.maximum(least, STRONG * part.max(axis=1, keepdims=True)))
    clear = strong.any(axis=1)
    outermost = near[1:-1][strong.shape[1] - 1 - np.argmax(strong[:, ::-1], axis=1)]
    beside = np.clip(outermost[:, None] + np.arange(-4, 5), 0, len(steps) - 1)  # ± 1 px
    weight = np.take_along_axis(energy, beside, axis=1)
    return np.sum(weight * steps[beside], axis=1) / np.maximum(weight.sum(axis=1), 1e-30), clear


def _softness(change: Array, offsets: Array, steps: Array) -> float:
    """Standard deviation [px] of the blur of the edge: that of the mean change across it, less that of a sharp edge.

    change: (K, sectors, T). offsets: (sectors,) position of the edge in each [px]. steps: (T,) [px].
    """
    aligned = np.stack(
        [
            [np.interp(steps + offset, steps, line, left=0.0, right=0.0) for line in lines]
            for lines, offset in zip(np.moveaxis(change, 1, 0), offsets, strict=True)
        ]
    )
    middle = np.argmin(np.abs(steps))
    mean = np.sum(aligned * np.sign(aligned[..., middle, None]), axis=(0, 1))
    below = np.flatnonzero(mean < FOOT * mean[middle])
    low = below[below < middle].max(initial=-1)
    high = below[below > middle].min(initial=len(steps))
    bump, places = mean[low + 1 : high], steps[low + 1 : high]
    return float(
        np.sqrt(max(np.average((places - np.average(places, weights=bump)) ** 2, weights=bump) - NARROWEST**2, 0.0))
    )
