"""Knit: stockinette (plain weft knit), its loops as paths through one period of the cloth. All in mm.

Courses run along u, wales along v; the face with the legs of the loops in front is the upper side.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.spatial import KDTree

from hagoromo.errors import InputError
from hagoromo.files.record import about
from hagoromo_matter.cloth.strand import Paths
from hagoromo_matter.cloth.wander import freedom, wander, wandered
from hagoromo_matter.cloth.yarn import Yarn, check_yarn

MUNDEN = 19.0  # stitch density × (length of a loop)² of dry relaxed wool (Munden, J. Text. Inst. 50, 1959, T448)
BULGE = 1.4  # parameter a of a loop: neighbouring heads are then more than a quarter of a wale apart
LOOPS = 8  # loops of a period in each direction; even, as courses alternate
STEPS_PER_DIAMETER = 8  # steps of a path per diameter
POINTS_PER_LOOP = 96  # points per loop from which a path is interpolated
CLOSEST = 0.75  # least distance between the axes of courses [diameters]: soft yarns flatten each other
DEEPEST = 1.6  # largest height of a loop above the middle of the cloth [diameters]


class Knitted(NamedTuple):
    """Stockinette: loops per cm along the courses (wales) and along the wales (courses), the yarn; uneven: spread of
    the yarn's place, of its diameter. loop_mm: yarn in a loop (0: as dry relaxed wool of as many loops has).
    """

    wales_per_cm: Annotated[float, about("loops per cm along a course [1/cm]")] = 6.5
    courses_per_cm: Annotated[float, about("loops per cm along a wale [1/cm]")] = 8.5
    yarn: Yarn = Yarn(0.42, 1.0, 2, 4.0, "S", 5.0, 58, 21.0, 0.2, 25.0, 0.8, 0.05, 0.02)
    loop_mm: Annotated[float, about("length of yarn in a loop; 0: that of dry relaxed wool of as many loops [mm]")] = (
        0.0
    )
    uneven: Annotated[float, about("standard deviation of the yarn's place, as a share of its diameter")] = 0.08

    @property
    def pitch(self) -> tuple[float, float]:
        """Distance between neighbouring wales and between neighbouring courses [mm]."""
        return 10.0 / self.wales_per_cm, 10.0 / self.courses_per_cm


class Loop(NamedTuple):
    """The curve of a loop: half its height and half its depth [mm]."""

    height: float
    depth: float


def check_knitted(cloth: Knitted) -> Knitted:
    """`cloth`, or `InputError` in one line where it cannot be knitted."""
    for key in ("wales_per_cm", "courses_per_cm"):
        if not (math.isfinite(getattr(cloth, key)) and getattr(cloth, key) > 0):
            raise InputError(f"{key} is {getattr(cloth, key)}: give a number above 0")
    if not 0 <= cloth.uneven <= 0.3:
        raise InputError(f"uneven is {cloth.uneven}: give a number from 0 to 0.3")
    if not (math.isfinite(cloth.loop_mm) and cloth.loop_mm >= 0):
        raise InputError(f"loop_mm is {cloth.loop_mm}: give a length, or 0 for that of relaxed wool")
    check_yarn(cloth.yarn, "yarn")
    loop_of(cloth)
    return cloth


def knitted_period(cloth: Knitted) -> tuple[float, float]:
    """Lengths along u and v after which the cloth repeats [mm]."""
    return LOOPS * cloth.pitch[0], LOOPS * cloth.pitch[1]


def loop_of(cloth: Knitted) -> Loop:
    """The loop of the given length of yarn whose courses touch where they cross."""
    (wale, course), diameter = cloth.pitch, cloth.yarn.diameter_mm
    wanted = cloth.loop_mm or 10.0 * math.sqrt(MUNDEN / (cloth.wales_per_cm * cloth.courses_per_cm))
    height, depth = course, 0.5 * diameter
    for _ in range(4):  # length and depth depend on each other only weakly
        try:
            height = _root(lambda h, d=depth: _length(wale, Loop(h, d)) - wanted, 0.5 * course, 2.0 * course)
            depth = _root(
                lambda d, h=height: _apart(wale, course, Loop(h, d)) - CLOSEST * diameter, 0.0, DEEPEST * diameter
            )
        except ValueError as error:  # no sign change
            raise InputError(
                f"a yarn of {diameter:g} mm does not fit {cloth.wales_per_cm:g} wales and "
                f"{cloth.courses_per_cm:g} courses per cm with "
                f"loops of {wanted:.3g} mm: give a thinner yarn, fewer loops or another loop_mm"
            ) from error
    return Loop(height, depth)


def knitted_paths(cloth: Knitted, margin: float, variants: int, seed: int) -> tuple[Paths, Paths]:
    """Paths of the even and of the odd courses; within `margin` [mm] of the border of the period all variants agree."""
    return _paths(cloth, 0, margin, variants, seed), _paths(cloth, 1, margin, variants, seed)


def loop_curve(wale: float, loop: Loop, turn: NDArray) -> NDArray[np.float64]:
    """A course at angles `turn`, 2π a loop (0 at the head): (n, 3).

    γ = (t + a sin 2t, h cos t, d cos 2t) of Crane, "A simple parametric model of plain-knit yarns", 2023.
    """
    across = (turn + BULGE * np.sin(2.0 * turn)) * (wale / (2.0 * np.pi))
    return np.stack([across, loop.height * np.cos(turn), -loop.depth * np.cos(2.0 * turn)], axis=-1)


def _paths(cloth: Knitted, parity: int, margin: float, variants: int, seed: int) -> Paths:
    yarn, period, loop = cloth.yarn, knitted_period(cloth), loop_of(cloth)
    drawn = np.random.default_rng((seed, parity)), np.random.default_rng((seed, parity, 1))
    turn = np.arange(LOOPS * POINTS_PER_LOOP + 1) * (2.0 * np.pi / POINTS_PER_LOOP)
    curve = loop_curve(cloth.pitch[0], loop, turn)
    base = np.repeat(curve[None], LOOPS // 2, axis=0)
    base[..., 1] += ((2 * np.arange(LOOPS // 2) + parity + 0.5) * cloth.pitch[1])[:, None]
    base[..., 0] += 0.25 * cloth.pitch[0]  # no head on the border
    length = LOOPS * _length(cloth.pitch[0], loop)
    free = freedom(base[:, :-1], period, margin)
    varied = wander(yarn, free, length, variants, drawn)
    along = np.gradient(curve[:, :2], axis=0)
    beside = np.stack([-along[:, 1], along[:, 0], 0.0 * along[:, 0]], axis=-1) / np.linalg.norm(
        along, axis=1, keepdims=True
    )
    beside = np.repeat(cloth.uneven * yarn.diameter_mm * beside[None], len(base), axis=0)
    turns, steps = round(yarn.rates[0] * length / (2.0 * np.pi)), round(length / yarn.diameter_mm * STEPS_PER_DIAMETER)
    samples = wandered(base, beside, varied, turns, steps)
    slope = np.abs(np.roll(samples["points"], -1, axis=2) - np.roll(samples["points"], 1, axis=2))[0]
    heads = (slope[..., 0] > slope[..., 1]).astype(np.int64)  # 0 legs, along v; 1 heads and feet, along u
    return Paths(**samples, turns=turns, population=heads)


def _root(function: Callable[[float], float], low: float, high: float) -> float:
    return float(brentq(function, low, high))  # type: ignore[arg-type]


def _length(wale: float, loop: Loop) -> float:
    """Length of the yarn in a loop [mm]."""
    curve = loop_curve(wale, loop, np.linspace(0.0, 2.0 * np.pi, 4 * POINTS_PER_LOOP + 1))
    return float(np.linalg.norm(np.diff(curve, axis=0), axis=1).sum())


def _apart(wale: float, course: float, loop: Loop) -> float:
    """Distance between the axes of neighbouring courses [mm]."""
    curve = loop_curve(wale, loop, np.linspace(-np.pi, np.pi, 8 * POINTS_PER_LOOP + 1))
    aside = np.array([wale, 0.0, 0.0])
    wide = np.concatenate([curve - aside, curve, curve + aside])
    return float(KDTree(wide + np.array([0.0, course, 0.0])).query(curve)[0].min())


JERSEY = Knitted()
