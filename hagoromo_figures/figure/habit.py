"""Habit: what a nun at prayer wears: a tunic with wide sleeves, linen about the face, a veil. In mm."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.matter.drape.cut import Cut, Place
from hagoromo.matter.drape.dressed import dressed, put_on
from hagoromo.matter.drape.settle import Fabric, Fall
from hagoromo.matter.drape.sheet import Sheet
from hagoromo.matter.drape.tube import Folds, Row, upright
from hagoromo.matter.shape import Shape, placed
from hagoromo_figures.figure.gown import SASH, SASH_AT, SHORT, sleeve
from hagoromo_figures.figure.mannequin import arm, trunk
from hagoromo_figures.figure.pose import PRAYER, Pose

WOOL, LINEN, CREPE = Fabric(2.2, 0.25, 0.6), Fabric(2.5, 0.6, 0.5), Fabric(1.8, 0.6, 0.6)
BUST, STEP = 5.8, (-1.0, -5.0, 0.5)  # of the mannequin
TUNIC = (
    Row(0, 440, 235, 0.9, 2), Row(56, 375, 200, 0.85, 1), Row(146, 240, 135, 0.75, 1), Row(176, 165, 112, 0.75, 1),
    Row(211, 148, 130, 0.65, 2), Row(226, 116, 112, 0.6, 3), Row(237, 60, 58, 0.95, 2.6),
)  # fmt: skip
WAIST, BELTED = 176.0, 3.0  # along the tunic, and half the height that is drawn in
NECK, TILT = 219.0, 7.5  # height of the upper hem, and how much higher it is behind
HABIT_SLEEVE = Row(0, 48, 47), Row(18, 62, 58), Row(50, 86, 78), Row(93, 132, 104)  # from the shoulder outwards
SLEEVE_GAP = 0.8  # from each sleeve to the middle, so that they do not pass through each other
COLLAR = Row(0, 172, 166, 0.72, 2), Row(24, 112, 108, 0.7, 3), Row(34, 56, 55, 0.9, 2), Row(40, 46, 46, 1.0, 0.5)
COLLAR_AT, COLLAR_TILT = (208.0, 228.5), 4.0
COIF = 74.0, 28.0  # along the edge of the face from throat to throat, and from it backwards
FACE = (0.0, -9.5, -4.6), (10.2, 13.4), 3.0  # of the head: middle and half sizes of its edge, half the angle around it
THROAT = (
    (1.7, 2.6),
    9.5,
    4.0,
)  # angles between which the coif comes to the throat; there behind: beside the neck, raised
VEIL = 178.0, 150.0
VEIL_AT = -8.5, 267.0  # y of its front edge and height, where it begins level
PINNED = 26.0, 7.0  # of its front edge, what is drawn to the head: width and depth


def habit(fall: Fall, pose: Pose = PRAYER) -> dict[str, list[Sheet]]:
    """habit: tunic, sash, left and right sleeve; linen: collar and coif; veil."""
    seed, body = fall.seed, partial(trunk, pose=pose, bust=BUST, step=STEP)
    fine, short = Fall(0.7 * fall.spacing, 0.4, 1, seed), fall._replace(levels=1, seconds=SHORT)
    tunic = put_on(
        [upright(TUNIC, (1.0, NECK), TILT, Folds(16, seed + 5), reach=_belted, held=_last_row)], [body], WOOL, fall
    )
    band = upright(SASH, SASH_AT, 0.0, Folds(5, seed + 1), reach=lambda s, t: np.full(np.broadcast(s, t).shape, 1.2))
    worn = tunic + put_on([band], [dressed(body, tunic)], WOOL, fine)
    sides = (1.0, -1.0)
    cuts = [sleeve(pose, side, layer, seed + 2, HABIT_SLEEVE) for layer, side in enumerate(sides)]
    worn += put_on(cuts, [_beside(pose, side) for side in sides], WOOL, short, dressed(body, worn))
    collar = upright(COLLAR, COLLAR_AT, COLLAR_TILT, Folds(9, seed + 4), held=_last_row)
    linen = put_on([collar], [dressed(body, worn)], LINEN, fine)
    linen += put_on([_coif(pose)], [dressed(body, linen)], LINEN, fine)
    below = dressed(lambda p: dr.fmin(body(p), dr.fmin(arm(p, pose, 1.0), arm(p, pose, -1.0))), worn + linen)
    return {"habit": worn, "linen": linen, "veil": put_on([_veil()], [below], CREPE, short)}


def _beside(pose: Pose, side: float) -> Shape:
    """What the sleeve of one side lies on besides the body: the arm, and the plane between the sleeves."""
    return lambda p: dr.fmin(arm(p, pose, side), side * p.x - SLEEVE_GAP)


def _coif(pose: Pose) -> Cut:
    """A band about the face from throat to throat, back over the head; its ends are fastened along the throat.

    Free ends would stand out under the jaw and pass through the veil.
    """
    (mx, my, mz), (wide, high), half = FACE
    (first, last), neck, raised = THROAT
    width, height = COIF

    def start(s: Place, t: Place) -> NDArray[np.floating]:
        angle, back = half * (1.0 - 2.0 * s), height * t
        opened = np.sin(np.minimum(back / 20.0, 1.0) * 0.5 * math.pi)
        across, side = -wide * np.sin(angle), -np.sign(angle)
        throat = np.clip((np.abs(angle) - first) / (last - first), 0.0, 1.0)
        throat = throat**2 * (3.0 - 2.0 * throat)
        behind = 1.36 * across + throat * side * np.maximum(neck - 1.36 * np.abs(across), 0.0)
        x = mx + across + opened * (behind - across)
        z = mz + high * (1.0 + 0.144 * opened) * np.cos(angle) + raised * throat * opened
        points = np.stack(np.broadcast_arrays(x, my + 0.92 * back, z), axis=-1)
        return points @ _turn(pose).T + np.asarray(pose.head)

    return Cut(width, height, start, held=lambda s, t: (t == 0.0) | (s == 0.0) | (s == 1.0))


def _veil() -> Cut:
    """A sheet that begins level over the head; the middle of its front edge is drawn to the head."""
    width, height = VEIL
    front, z = VEIL_AT

    def start(s: Place, t: Place) -> NDArray[np.floating]:
        return np.stack(np.broadcast_arrays(width * (s - 0.5), front + height * t, z), axis=-1)

    def reach(s: Place, t: Place) -> Place:
        return np.where((np.abs(s - 0.5) * width < 0.5 * PINNED[0]) & (t * height < PINNED[1]), 0.9, np.inf)

    return Cut(width, height, start, reach=reach, held=lambda s, t: np.isfinite(reach(s, t)))


def _turn(pose: Pose) -> NDArray[np.floating]:
    """The turn of the head from its own axes to the world's."""
    from hagoromo.backend import arrays

    axes: Any = placed(arrays().Array3f([1, 0, 0], [0, 1, 0], [0, 0, 1]), (0.0, 0.0, 0.0), pose.nod)
    return np.array(axes).T


def _belted(s: Place, t: Place) -> Place:
    return np.where(np.abs(t * TUNIC[-1].along - WAIST) < BELTED, 1.0, np.inf) + np.zeros_like(s)


def _last_row(s: Place, t: Place) -> Place:
    return (t == 1.0) + np.zeros_like(s)
