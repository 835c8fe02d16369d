"""Habit: what a nun at prayer wears: a tunic with wide sleeves, linen about the face, a veil. In mm."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.matter.shape import Shape, placed
from hagoromo_matter.drape.cut import Cut, Place
from hagoromo_matter.drape.dressed import dressed, put_on
from hagoromo_matter.drape.settle import ClothMechanics, Fall
from hagoromo_matter.drape.sheet import Sheet
from hagoromo_matter.drape.tube import Folds, TubeRow, upper_hem, upright
from hagoromo_matter.figure.gown import NECK, NECKLINE, SASH, SASH_AT, SHORT, TILT, sleeve
from hagoromo_matter.figure.mannequin import arm, trunk
from hagoromo_matter.figure.pose import PRAYER, Pose

WOOL, LINEN, CREPE = ClothMechanics(2.2, 0.25, 0.6), ClothMechanics(2.5, 0.6, 0.5), ClothMechanics(1.8, 0.6, 0.6)
BUST, STEP = 5.8, (-1.0, -5.0, 0.5)  # of the mannequin
TUNIC = (
    TubeRow(0, 440, 235, 0.9, 2), TubeRow(56, 375, 200, 0.85, 1), TubeRow(146, 240, 135, 0.75, 1),
    TubeRow(176, 165, 112, 0.75, 1),
    TubeRow(211, 148, 130, 0.65, 2), *NECKLINE,
)  # fmt: skip
WAIST, BELTED = 176.0, 3.0  # along the tunic, and half the height that is drawn in
HABIT_SLEEVE = (
    TubeRow(0, 48, 47),
    TubeRow(18, 62, 58),
    TubeRow(50, 86, 78),
    TubeRow(93, 132, 104),
)  # from the shoulder outwards
SLEEVE_GAP = 0.8  # from each sleeve to the middle, so that they do not pass through each other
COLLAR = (
    TubeRow(0, 172, 166, 0.72, 2),
    TubeRow(24, 112, 108, 0.7, 3),
    TubeRow(39, 56, 55, 0.9, 2),
    TubeRow(45, 46, 46, 1.0, 0.5),
)
COLLAR_AT, COLLAR_TILT = (208.0, 240.0), 27.0  # beside the neck above the coif's lower hem, in front below the chin
# Around it behind, and from the edge of the face backwards. Behind, it goes over the head and down over the throat: cut
# much narrower than that way (154 mm), its throat is drawn up by its own springs, and bunches under the chin.
COIF = 145.0, 25.0
FACE = (0.0, -9.5, -5.3), (10.2, 14.1)  # of the head: middle and half sizes of the edge of the face
WIDER, HIGHER, OPENED = 1.36, 1.144, 20.0  # behind than at the face, from this far back
AT_FACE = 0.53  # its width there, of its width behind: the edge of the face is 77 mm long
THROAT = (1.7, 2.6), (-0.25, -0.85)  # angles between which it comes under the chin, and its way (y, z) there
VEIL = 178.0, 150.0
VEIL_AT = -8.5, 267.0  # y of its front edge and height, where it begins level
PINNED = 26.0, 7.0  # of its front edge, what is drawn to the head: width and depth


def habit(fall: Fall, pose: Pose = PRAYER) -> dict[str, list[Sheet]]:
    """habit: tunic, sash, left and right sleeve; linen: collar and coif; veil."""
    seed, body = fall.seed, partial(trunk, pose=pose, bust=BUST, step=STEP)
    fine, short = Fall(0.7 * fall.spacing, 0.4, 1, seed), fall._replace(levels=1, seconds=SHORT)
    tunic = put_on(
        [upright(TUNIC, (1.0, NECK), TILT, Folds(16, seed + 5), reach=_belted, held=upper_hem)], [body], WOOL, fall
    )
    band = upright(SASH, SASH_AT, 0.0, Folds(5, seed + 1), reach=lambda s, t: np.full(np.broadcast(s, t).shape, 1.2))
    worn = tunic + put_on([band], [dressed(body, tunic)], WOOL, fine)
    sides = (1.0, -1.0)
    cuts = [sleeve(pose, side, layer, seed + 2, HABIT_SLEEVE) for layer, side in enumerate(sides)]
    worn += put_on(cuts, [_beside(pose, side) for side in sides], WOOL, short, dressed(body, worn))
    collar = upright(COLLAR, COLLAR_AT, COLLAR_TILT, Folds(9, seed + 4), held=upper_hem)
    linen = put_on([collar], [dressed(body, worn)], LINEN, fine)
    linen += put_on([_coif(pose)], [dressed(body, linen)], LINEN, fine)
    below = dressed(lambda p: dr.fmin(body(p), dr.fmin(arm(p, pose, 1.0), arm(p, pose, -1.0))), worn + linen)
    return {"habit": worn, "linen": linen, "veil": put_on([_veil()], [below], CREPE, short)}


def _beside(pose: Pose, side: float) -> Shape:
    """What the sleeve of one side lies on besides the body: the arm, and the plane between the sleeves."""
    return lambda p: dr.fmin(arm(p, pose, side), side * p.x - SLEEVE_GAP)


def _coif(pose: Pose) -> Cut:
    """A tube about the face, back over the head and, under the chin, down over the collar.

    It is closed below: ends at the throat would part and show the neck.
    """
    (mx, my, mz), (wide, high) = FACE
    (first, last), (forwards, down) = THROAT
    width, height = COIF

    def opened(t: Place) -> Place:
        return np.sin(np.minimum(height * t / OPENED, 1.0) * 0.5 * math.pi)

    def start(s: Place, t: Place) -> NDArray[np.floating]:
        angle, back, more = math.pi * (1.0 - 2.0 * s), height * t, opened(t)
        throat = np.clip((np.abs(angle) - first) / (last - first), 0.0, 1.0)
        throat = throat**2 * (3.0 - 2.0 * throat)
        x = mx - wide * (1.0 + (WIDER - 1.0) * more) * np.sin(angle)
        y = my + (0.92 * (1.0 - throat) + forwards * throat) * back
        z = mz + high * (1.0 + (HIGHER - 1.0) * more * (1.0 - throat)) * np.cos(angle) + down * throat * back
        points = np.stack(np.broadcast_arrays(x, y, z), axis=-1)
        return points @ _turn(pose).T + np.asarray(pose.head)

    return Cut(
        width, height, start, True, lambda t: AT_FACE + (1.0 - AT_FACE) * opened(t),
        held=lambda s, t: (t == 0.0) + np.zeros_like(s),
    )  # fmt: skip


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
