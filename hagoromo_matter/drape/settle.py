"""Settle: cloth falls over bodies and on the floor z = 0, and comes to rest in folds. Units: mm and s.

Points of a grid are masses; neighbours are joined by springs along the yarns and, weaker, across them; the cloth bends
as stiffly as its bending length says. Small steps of symplectic Euler, one pass over the springs in each (Macklin et
al. 2019, "Small steps in physics simulation"), are as stiff as the step allows, and the step is chosen by the strain
allowed. Every point gathers its own forces: the same input gives the same bits.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import drjit as dr
import numpy as np

from hagoromo.backend import arrays, clip
from hagoromo.errors import InputError
from hagoromo_matter.drape.collider import Collider
from hagoromo_matter.drape.contact import Contacts
from hagoromo_matter.drape.cut import Cut
from hagoromo_matter.drape.resident import frozen, resident
from hagoromo_matter.drape.sheet import Sheet
from hagoromo_matter.drape.springs import mesh_of

GRAVITY = 9810.0  # mm/s²
STRETCH, SHEAR, TOUCH = 0.4, 0.05, 0.08  # stiffness of springs [mass/step²]; stable while the sum at a point is < 4
FRICTION_INSIDE = 0.04  # share of the relative speed along a spring, or at a contact, that a step removes
STRAIN = 0.02  # strain of the cloth where the load is largest
DRAW = 200.0  # [mm/s] speed at which a belt is drawn in
PUSH = 300.0  # [mm/s] speed at which points inside a body are pushed out; a jump would tear the cloth
QUICKEST = 0.2  # [spacings] largest move of a point in a step: several times its fall, too little to tear the cloth
GRIP = 0.05  # share of the speed that a belt removes in a step
TOUCH_EVERY = 1 / 200  # [s] between searches for contacts
CONTACT_SEARCH_SPACINGS = 1.6  # [spacings] of this search; points touch at 1
FALL, REST = 8.0, 40.0  # [1/s] drag of the air while the cloth falls, and at the end to bring it to rest


class ClothMechanics(NamedTuple):
    """bending: bending length (Peirce 1930: cubed, stiffness over weight) [mm]; friction: coefficient; clear: of its
    middle from bodies and floor [mm].
    """

    bending: float = 3.0
    friction: float = 0.4
    clear: float = 0.6


class Fall(NamedTuple):
    """The simulation: spacing of the points [mm], seconds of fall on the coarsest grid, levels of grids, each
    twice as fine as the one before, seed of the small disorder from which folds begin. guard: least distance of the
    points from bodies [spacings]: above √½ nothing slips between them, however thin.
    """

    spacing: float = 1.5
    seconds: float = 1.2
    levels: int = 2
    seed: int = 0
    guard: float = 0.0


def settled(
    cuts: Sequence[Cut],
    collider: Collider,
    fabric: ClothMechanics = ClothMechanics(),  # noqa: B008
    fall: Fall = Fall(),  # noqa: B008
) -> list[Sheet]:
    """The pieces at rest, in their order. They touch each other, the floor and the bodies of `collider`."""
    check(fabric, fall)
    sheets: list[Sheet | None] = [None] * len(cuts)
    for level in range(fall.levels):
        spacing, seconds = fall.spacing * 2.0 ** (fall.levels - 1 - level), fall.seconds / 2.0**level
        begin = [cut.sheet(spacing, sheet) for cut, sheet in zip(cuts, sheets, strict=True)]
        clear = max(fabric.clear, fall.guard * spacing)
        sheets[:] = _after(cuts, begin, collider, fabric._replace(clear=clear), spacing, seconds, fall.seed + level)
    return [sheet for sheet in sheets if sheet is not None]


def check(fabric: ClothMechanics, fall: Fall) -> None:
    """Raise `InputError` for numbers with which no cloth settles."""
    if not (np.isfinite(fabric).all() and fabric.bending >= 0 and fabric.friction >= 0 and fabric.clear >= 0):
        raise InputError(f"{fabric}: give finite numbers, none below 0")
    if not (np.isfinite(fall.spacing) and fall.spacing > 0 and fall.levels >= 1 and 0 < fall.seconds < 60):
        raise InputError(f"{fall}: give a spacing above 0, up to 60 seconds and at least one level")


def _after(
    cuts: Sequence[Cut],
    sheets: Sequence[Sheet],
    collider: Collider,
    fabric: ClothMechanics,
    spacing: float,
    seconds: float,
    seed: int,
) -> list[Sheet]:
    """Sheets after `seconds` of fall, the last third of it at rest."""
    jit, mesh = arrays(), mesh_of(cuts, sheets, spacing)
    points = np.concatenate([sheet.points.reshape(-1, 3) for sheet in sheets])
    draw = np.random.default_rng(seed).normal(size=points.shape) * 0.02 * spacing
    points = points + np.where(mesh["held"].numpy()[:, None] > 0, 0.0, draw)
    longest = max(cut.height if cut.closed else max(cut.height, cut.width) for cut in cuts)
    step = spacing * math.sqrt(STRETCH * STRAIN / (GRAVITY * longest))
    apart = np.concatenate([cut.over(cut.apart, spacing).ravel() for cut in cuts])
    narrow = np.concatenate([cut.over(cut.narrow, spacing).ravel() for cut in cuts])
    contacts = Contacts(sheets, apart > 0, narrow)
    numbers = {
        "step": step, "bend": GRAVITY * fabric.bending**3, "clear": fabric.clear, "friction": fabric.friction,
        "thick": spacing,
    }  # fmt: skip
    mesh |= {name: dr.opaque(jit.Float, value) for name, value in numbers.items()}
    mesh["body"] = collider.values  # a frozen function reads only its arguments
    move = frozen(lambda place, speed, touching, drag, mesh: _moved(place, speed, touching, drag, mesh, collider))
    place = jit.Array3f(*(resident(jit.Float, points[:, k].astype(np.float32)) for k in range(3)))
    speed = dr.zeros(jit.Array3f, len(points))
    turns, every = math.ceil(seconds / step), max(round(TOUCH_EVERY / step), 1)
    for turn in range(turns):
        if turn % every == 0:
            now = np.array(place, np.float64).T
            touching = [resident(jit.UInt, row) for row in contacts.candidates(now, CONTACT_SEARCH_SPACINGS * spacing)]
            ease = FALL + (REST - FALL) * min(max(3.0 * turn / turns - 1.5, 0.0), 1.0)
            drag = dr.opaque(jit.Float, math.exp(-ease * step))
        place, speed = move(place, speed, touching, drag, mesh)
    now, starts = np.array(place, np.float64).T, np.cumsum([0] + [sheet.u.size for sheet in sheets])
    if not np.isfinite(now).all():
        raise InputError("the cloth did not come to rest: give a shorter bending length or a wider spacing")
    return [
        Sheet(now[first:last].reshape(sheet.points.shape), sheet.u, sheet.v, sheet.around)
        for sheet, first, last in zip(sheets, starts[:-1], starts[1:], strict=True)
    ]


def _moved(place: Any, speed: Any, touching: Sequence[Any], drag: Any, mesh: dict[str, Any], collider: Collider) -> Any:
    """Places and speeds one step later."""
    jit, step = arrays(), mesh["step"]
    stiff = dr.rcp(dr.square(step))
    pull = jit.Array3f(0.0, 0.0, -GRAVITY)
    for springs, share in ((mesh["along"], STRETCH), (mesh["across"], SHEAR)):
        for other, rest in springs:
            offset = dr.gather(jit.Array3f, place, other) - place
            length = dr.norm(offset) + 1e-6
            direction = offset / length
            closing = dr.dot(dr.gather(jit.Array3f, speed, other) - speed, direction)
            force = share * stiff * (length - rest) + FRICTION_INSIDE / step * closing
            pull += direction * dr.select(rest > 0, force, 0.0)
    for before, after, before2, after2, share in mesh["bends"]:
        one, two = (dr.gather(jit.Array3f, place, index) for index in (before, after))
        middle = one + two - 2.0 * place
        first = dr.gather(jit.Array3f, place, before2[0]) + place - 2.0 * one
        last = dr.gather(jit.Array3f, place, after2[0]) + place - 2.0 * two
        pull += (middle * (2.0 * share) - first * before2[1] - last * after2[1]) * mesh["bend"]
    own = dr.arange(jit.UInt, dr.width(place))
    for other in touching:
        offset = dr.gather(jit.Array3f, place, other) - place
        far = dr.norm(offset) + 1e-6
        deep = dr.fmax(mesh["thick"] - far, 0.0)
        slip = dr.gather(jit.Array3f, speed, other) - speed
        force = slip * (FRICTION_INSIDE / step) - offset * (TOUCH * stiff * deep / far)
        pull += dr.select((deep > 0) & (other != own), force, 0.0)
    speed = (speed + pull * step) * drag
    speed *= dr.fmin(1.0, QUICKEST * mesh["thick"] / (step * (dr.norm(speed) + 1e-9)))
    moved = place + speed * step
    moved, speed = _held_off(moved, speed, *collider.distance_and_normal(moved, mesh["layer"]), mesh)
    moved, speed, near = _drawn_in(moved, speed, *collider.distance_and_normal(moved, mesh["layer"]), mesh)
    moved, speed = _held_off(moved, speed, moved.z, jit.Array3f(0, 0, 1), mesh)
    free = (mesh["held"] <= 0) | ~near
    return dr.select(free, moved, place), dr.select(free, speed, 0.0)


def _held_off(place: Any, speed: Any, distance: Any, normal: Any, mesh: dict[str, Any]) -> tuple[Any, Any]:
    """Points pushed out of a body, and their speed after the push and the friction of it (Coulomb)."""
    deep = clip(mesh["clear"] - distance, 0.0, PUSH * mesh["step"])
    inwards = dr.fmin(dr.dot(speed, normal), 0.0)
    slide = speed - normal * dr.dot(speed, normal)
    quick = dr.norm(slide) + 1e-9
    slower = dr.fmax(1.0 - mesh["friction"] * (deep / mesh["step"] - inwards) / quick, 0.0)
    after = slide * slower + normal * (dr.dot(speed, normal) - inwards)
    touching = deep > 0
    return place + normal * deep, dr.select(touching, after, speed)


def _drawn_in(place: Any, speed: Any, distance: Any, normal: Any, mesh: dict[str, Any]) -> tuple[Any, Any, Any]:
    """Points of a belt nearer to the body, the belt's grip on their speed, and whether they are within reach."""
    over = dr.fmax(distance - mesh["reach"], 0.0)
    slower = (speed - normal * dr.fmax(dr.dot(speed, normal), 0.0)) * (1.0 - GRIP)
    return place - normal * dr.fmin(over, DRAW * mesh["step"]), dr.select(over > 0, slower, speed), over <= 0
