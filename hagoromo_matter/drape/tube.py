"""Tube: cuts whose initial place is a folded tube around a body or an arm. Rows run up, or outwards. In mm."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from hagoromo_matter.drape.cut import Cut, Place

ENTRIES = 257  # entries of the tables along a tube
TUBE_ANGLES = np.linspace(0.0, 2.0 * math.pi, 1441)  # [rad] angles around a tube, from seam to seam
ROUND, FAN = 4.0, 20.0  # half the ways over which a tube along an arm, and its rows, turn at the elbow
OUTWARDS = 0.4  # of the way that a wide sleeve hangs down, how far it does so to the side
TILTED = 6  # how near its upper hem a tube tilts with it: share of the length to this power


class TubeRow(NamedTuple):
    """A row of a tube: how far from the first, its width at rest, girth of the tube that it begins around, depth of
    that over its breadth, and the y of its middle.
    """

    along: float
    width: float
    girth: float
    depth: float = 1.0
    place: float = 0.0


class Folds(NamedTuple):
    """Folds in which a tube begins where it is wider than its girth: how many, and seed of their places and depths."""

    count: int
    seed: int


def upper_hem(s: Place, t: Place) -> Place:
    """Where a tube is held by its last row."""
    return (t == 1.0) + np.zeros_like(s)


def upright(rows: Sequence[TubeRow], heights: tuple[float, float], tilt: float, folds: Folds, **record: Any) -> Cut:
    """A tube that begins around the axis z between the heights of its hems, its seam behind.

    tilt: how much higher the upper hem is behind than in front. record: more of the `Cut`.
    """
    height, tables = rows[-1].along, _tables(rows)
    width, girth, depth, place = tables
    half = girth / (2.0 * math.pi * np.sqrt(0.5 * (1.0 + depth**2)))  # of an ellipse, to 2 % for depths above ½
    step = height / (ENTRIES - 1)
    z = np.cumsum(np.sqrt(np.clip(1.0 - np.gradient(half * np.sqrt(depth), step) ** 2, 0.04, 1.0)))
    z = heights[0] + (heights[1] - heights[0]) * (z - z[0]) / (z[-1] - z[0])

    def start(s: Place, t: Place) -> NDArray[np.floating]:
        points = []
        for share in t.ravel():
            x, r, y, up, wide = (_at(share, table) for table in (half, half * depth, place, z, width))
            turn, out = _folded(s.ravel(), wide, x, r, folds)
            rise = up + 0.5 * tilt * np.cos(turn) * share**TILTED
            points.append(np.stack([-x * out * np.sin(turn), y + r * out * np.cos(turn), rise], axis=-1))
        return np.array(points)

    return _cut(height, width, start, record)


def along_arm(joints: Sequence[Sequence[float]], rows: Sequence[TubeRow], folds: Folds, **record: Any) -> Cut:
    """A tube that begins around the line through `joints` and straight on, its seam below.

    Rows wider than the first hang from the arm, down and outwards. The depth and place of rows are ignored.
    """
    places = np.asarray(joints, float)
    knots = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(places, axis=0), axis=1))])
    height, (width, girth, *_) = rows[-1].along, _tables(rows)
    outwards = (OUTWARDS * float(np.sign(places[1, 0])), 0.0, -1.0)

    def line(at: float) -> NDArray[np.floating]:
        return np.array([np.interp(at, knots, column) for column in places.T])

    def start(s: Place, t: Place) -> NDArray[np.floating]:
        points = []
        for share in t.ravel():
            at = min(share * height, knots[-1])
            axis = _unit(line(at + FAN) - line(at - FAN))
            side = _unit(np.cross(axis, (0.0, 0.0, 1.0)))
            up, radius = np.cross(side, axis), _at(share, girth) / (2.0 * math.pi)
            turn, out = _folded(s.ravel(), _at(share, width), radius, radius, folds)
            hanging = _unit(outwards - axis * np.dot(outwards, axis)) * max(radius - girth[0] / (2.0 * math.pi), 0.0)
            middle = 0.5 * (line(at + ROUND) + line(at - ROUND)) + axis * (share * height - at) + hanging
            around = side * np.sin(turn)[:, None] - up * np.cos(turn)[:, None]
            points.append(middle + around * (radius * out)[:, None])
        return np.array(points)

    return _cut(height, width, start, record)


def _cut(height: float, width: NDArray, start: Callable[..., NDArray], record: dict[str, Any]) -> Cut:
    widest = float(width.max())
    return Cut(
        widest, height, start, True, lambda t: np.interp(t, np.linspace(0.0, 1.0, ENTRIES), width / widest), **record
    )


def _tables(rows: Sequence[TubeRow]) -> list[NDArray[np.floating]]:
    """width, girth, depth and place at ENTRIES lengths along a tube."""
    along, *columns = np.array(rows, float).T
    length = np.linspace(0.0, along[-1], ENTRIES)
    return [PchipInterpolator(along, column)(length) for column in columns]


def _at(share: float, table: NDArray[np.floating]) -> float:
    return float(np.interp(share * (ENTRIES - 1), np.arange(ENTRIES), table))


def _folded(s: Place, width: float, x: float, y: float, folds: Folds) -> tuple[NDArray, NDArray]:
    """Angle from the seam, and radius in shares of an ellipse's, of the places s on a row of this width around it."""
    draw = np.random.default_rng(folds.seed).uniform(-1.0, 1.0, (2, 4))
    swing = sum(a * np.sin((k + 1) * TUBE_ANGLES + math.pi * b) for k, (a, b) in enumerate(draw.T)) / 3.0
    deep = 1.0 + 0.5 * np.sin(2.0 * TUBE_ANGLES + math.pi * draw[0, 0]) * np.cos(
        3.0 * TUBE_ANGLES + math.pi * draw[1, 1]
    )
    wave = deep * np.cos(folds.count * TUBE_ANGLES + 2.0 * swing)
    girth = _lengths(np.ones_like(TUBE_ANGLES), x, y)[-1]
    # a wave of slope q makes a circle longer by √(1 + q²/2)
    size = math.sqrt(2.0 * max((width / girth) ** 2 - 1.0, 0.0)) / folds.count
    out = 1.0 + size * wave
    length = _lengths(out, x, y)
    turn = np.interp(s, length / length[-1], TUBE_ANGLES)
    return turn, np.interp(turn, TUBE_ANGLES, out) * (width / length[-1])


def _lengths(out: NDArray, x: float, y: float) -> NDArray:
    """Length of a closed curve from the seam to each of TUBE_ANGLES."""
    steps = np.hypot(np.diff(x * out * np.sin(TUBE_ANGLES)), np.diff(y * out * np.cos(TUBE_ANGLES)))
    return np.concatenate([[0.0], np.cumsum(steps)])


def _unit(vector: NDArray) -> NDArray:
    return vector / np.linalg.norm(vector, axis=-1, keepdims=True)
