"""Gown: the robe of an angel that opens its arms: a belted gown with a cowl, a sash and wide sleeves. All in mm."""

from __future__ import annotations

from functools import partial

import numpy as np

from hagoromo_matter.drape.cut import Cut, Place
from hagoromo_matter.drape.dressed import dressed, put_on
from hagoromo_matter.drape.settle import ClothMechanics, Fall
from hagoromo_matter.drape.sheet import Sheet
from hagoromo_matter.drape.tube import Folds, TubeRow, along_arm, upper_hem, upright
from hagoromo_matter.figure.mannequin import arm, trunk
from hagoromo_matter.figure.pose import WELCOME, Pose

CLOTH = ClothMechanics(bending=2.0, friction=0.25, clear=0.6)
# the rows above the chest, of every tunic: the last one lies close around the neck and its muscles, and is held there
NECKLINE = TubeRow(226, 116, 112, 0.6, 3), TubeRow(237, 77, 77, 0.7, 2.8)
NECK, TILT = 219.0, 7.5  # height of the upper hem, and how much higher it is behind
# from the hem up: skirt, waist, bodice, neck
GOWN = (
    TubeRow(0, 430, 235, 0.9, 2), TubeRow(56, 370, 200, 0.85, 1), TubeRow(146, 240, 135, 0.75, 1),
    TubeRow(176, 175, 112, 0.75, 1),
    TubeRow(211, 150, 130, 0.65, 2), *NECKLINE,
)  # fmt: skip
WAIST, BELTED = 176.0, 3.5  # along the gown, and half the height that is drawn in
SASH = TubeRow(0, 113, 124, 0.75, 1), TubeRow(7.5, 113, 124, 0.75, 1)
SASH_AT = 166.5, 173.5
SHORT = 0.8  # s, fall of what is put on with points so near that an arm does not slip between them
CLING = 0.06, 0.78, 0.045  # of a sleeve to the arm: half a share of its width; middle and half, shares of its length
GOWN_SLEEVE = (
    TubeRow(0, 48, 47),
    TubeRow(18, 64, 60),
    TubeRow(48, 108, 98),
    TubeRow(86, 170, 155),
)  # from the shoulder outwards
ROOT = (15.0, 4.0, 208.0), (21.5, 3.5, 203.0)  # of a sleeve, inside the shoulder


def gown(fall: Fall, pose: Pose = WELCOME) -> list[Sheet]:
    """Gown, sash, left and right sleeve, at rest on a figure in a pose."""
    seed, body = fall.seed, partial(trunk, pose=pose)
    skirt = upright(GOWN, (1.0, NECK), TILT, Folds(17, seed), reach=_belted, held=upper_hem)
    dress = put_on([skirt], [body], CLOTH, fall)
    band = upright(SASH, SASH_AT, 0.0, Folds(5, seed + 1), reach=lambda s, t: np.full(np.broadcast(s, t).shape, 1.2))
    sash = put_on([band], [dressed(body, dress)], CLOTH, Fall(0.7 * fall.spacing, 0.3, 1, seed + 1))
    sides = (1.0, -1.0)
    cuts = [sleeve(pose, side, layer, seed + 2) for layer, side in enumerate(sides)]
    worn = dressed(body, dress + sash)
    arms = [lambda p, side=side: arm(p, pose, side) for side in sides]
    return dress + sash + put_on(cuts, arms, CLOTH, fall._replace(levels=1, seconds=SHORT), worn)


def sleeve(pose: Pose, side: float, layer: int, seed: int, rows: tuple[TubeRow, ...] = GOWN_SLEEVE) -> Cut:
    """A wide sleeve of one side, from inside the shoulder to the wrist; side 1 the figure's left, −1 its right."""
    joints = [(side * x, y, z) for x, y, z in (*ROOT, pose.elbow, pose.wrist)]
    return along_arm(
        joints, rows, Folds(5, seed + layer), layer=layer, reach=_clinging,
        held=lambda s, t: (t == 0.0) | np.isfinite(_clinging(s, t)),
    )  # fmt: skip


def _clinging(s: Place, t: Place) -> Place:
    """A sleeve would slide from a raised forearm: a strip of its upper side clings to it."""
    return np.where((np.abs(s - 0.5) < CLING[0]) & (np.abs(t - CLING[1]) < CLING[2]), 1.0, np.inf)


def _belted(s: Place, t: Place) -> Place:
    return np.where(np.abs(t * GOWN[-1].along - WAIST) < BELTED, 1.0, np.inf) + np.zeros_like(s)
