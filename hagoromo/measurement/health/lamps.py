"""Lamps: how strong each lamp is beside the others, and where it is, by the photographs under the others.

From normals that the other photographs give, each photograph has a lamp of its own by least squares, whose length is
its strength and whose direction is compared with the stated one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from hagoromo.least_squares.loss import robust_scale
from hagoromo.measurement.health.health import Check, doubtful, good_where_noticed
from hagoromo.measurement.health.shading import Array, ShadingSample
from hagoromo.measurement.trials import Trials, tried
from hagoromo.photograph.exponent import FLOOR, RELATIVE, ROBUST, loss

ROUNDS = 4  # of the robust fit of a lamp
POWERS = (1.0, 2.2, 1.0 / 2.2)  # of linear values, of display values, and of linear ones that were decoded
CLEARLY = 0.8  # misfit with another power over that of linear values, from which it is taken
TURNS = 40  # of strengths and normals in turn
SETTLED = 1e-3  # change of ln strength
MOST_APART = 24  # photographs up to which each lamp is fitted to normals without it
UNEVEN = 0.03  # standard deviation of ln strength that is said
# Misfit with strengths over that without, from which they are said to differ: where one lamp stands out by so many
# robust deviations of the others, and where none does. Strengths of all lamps also explain a part of a gloss.
EXPLAINED_BY_ONE, EXPLAINED_BY_ALL, STANDS_OUT = 0.85, 0.65, 4.0
# A lamp is off that is so far from where it is stated, and whose photograph then fits so much better, also without the
# squares that gain most: a few mixed ones would decide where two facets or a wall leave a direction open. Lamps that
# are read from a chrome ball are uncertain by 1° to 3°.
OFF_DEG, OWN_MISFIT, LEFT_OUT = 4.0, 0.7, 0.05
CONTRADICTS = 0.5  # misfit from which photographs say anything: residuals are as large as the model's errors
PARTS, SURE = 8, 4.5  # parts of the object that are left out in turn, and errors so found of a lamp that is off
TURNED_DEG, STRONGER = 8.0, 1.4  # mistakes of trials
HIDDEN = "gloss, shadows or a surface that faces few ways hide it"
FEWEST_READINGS = 20  # of a photograph, by which its lamp is fitted
MOST_OFF = 3  # lamps that are named


class FittedLamps(NamedTuple):
    """strength: (K,) of mean logarithm 0. direction: (K, 3) unit. misfit: with these strengths, and without. power: of
    the values that follows light best, with the strengths free: of POWERS.
    """

    strength: Array
    direction: Array
    misfit: tuple[float, float]
    power: float = 1.0

    @property
    def spread(self) -> float:
        """Standard deviation of ln strength over the stated ones."""
        return float(np.std(np.log(self.strength)))

    @property
    def farthest(self) -> int:
        """Number of the lamp whose strength differs most from the stated one."""
        return int(np.argmax(np.abs(np.log(self.strength))))

    def even(self, shading: ShadingSample) -> ShadingSample:
        """The sample without the differences in strength, where they are evident."""
        return replace(shading, values=shading.values / self.strength[:, None]) if self.uneven else shading

    @property
    def uneven(self) -> bool:
        """Whether strengths that differ explain the photographs better than those that were stated."""
        log_strength = np.log(self.strength)
        off = log_strength - np.median(log_strength)
        one = np.abs(off).max() > STANDS_OUT * robust_scale(off)
        explained = self.misfit[0] < (EXPLAINED_BY_ONE if one else EXPLAINED_BY_ALL) * self.misfit[1]
        return self.spread > UNEVEN and explained and self.misfit[1] > CONTRADICTS


def fitted_lamps(shading: ShadingSample, powers: Sequence[float] = POWERS) -> FittedLamps:
    """Strengths, then directions of the lamps, with values to one of `powers`, 1 among them.

    Strengths of linear values also explain a part of what another transfer does, and would hide it.
    """
    found = {power: _strengths(shading.few(), power) for power in powers}
    power = min(found, key=lambda one: found[one].misfit[0])
    best = found[power] if found[power].misfit[0] < CLEARLY * found[1.0].misfit[0] else found[1.0]
    even = best.even(shading.few())
    return best._replace(direction=_directions(replace(even, values=np.maximum(even.values, 1e-300) ** best.power)))


def _strengths(few: ShadingSample, power: float, start: Array | None = None) -> FittedLamps:
    """Strengths with which values to that power follow light best. start: (K,) logarithms that the search begins at."""
    few = replace(few, values=np.maximum(few.values, 1e-300) ** power)
    log_strength = np.zeros(len(few.values)) if start is None else power * start
    for _ in range(TURNS):
        even = replace(few, values=few.values / np.exp(log_strength)[:, None])
        _, g = even.fit()
        length = np.linalg.norm([_lamp(even, k, g) for k in range(len(few.values))], axis=1)
        step = np.where(few.usable.sum(axis=1) < FEWEST_READINGS, 0.0, np.log(np.maximum(length, 1e-3)))
        step -= np.median(step)
        log_strength = log_strength + 1.5 * step
        if np.abs(step).max() < SETTLED:
            break
    log_strength = (log_strength - log_strength.mean()) / power
    even = replace(few, values=few.values / np.exp(power * log_strength)[:, None])
    misfits = tuple(loss(one.fit()[0] / power, one.usable) for one in (even, few))
    return FittedLamps(np.exp(log_strength), few.direction, (misfits[0], misfits[1]), power)


def _directions(shading: ShadingSample) -> Array:
    """(K, 3) of lamps by the normals that the other photographs give."""
    found, count = [], len(shading.values)
    _, g = shading.fit()
    for k in range(count):
        g = _by_others(shading, k) if count <= MOST_APART else g
        found.append(_lamp(shading, k, g))
    few = shading.usable.sum(axis=1, keepdims=True) < FEWEST_READINGS
    lamps = np.where(few, shading.direction, np.array(found))
    return lamps / np.maximum(np.linalg.norm(lamps, axis=1, keepdims=True), 1e-300)


def _by_others(shading: ShadingSample, number: int) -> Array:
    """(P, 3) normals times albedo that the photographs but for one give."""
    others = shading.usable.copy()
    others[number] = False
    return replace(shading, usable=others).fit()[1]


def _lamp(shading: ShadingSample, number: int, g: Array) -> Array:
    """(3,) the lamp, from the middle of the object, with which `g` (P, 3) gives the values of the photograph `number`,
    robust against highlights and cast shadows. What its direction differs by from place to place is as stated.
    """
    values, size = shading.values[number], np.linalg.norm(g, axis=1)
    error = np.hypot(RELATIVE * values, FLOOR * size)
    weight = np.where(shading.usable[number] & (size > 0.0), 1.0 / np.maximum(error, 1e-300), 0.0)
    values = values - np.sum(g * (shading.to_lamp[number] - shading.direction[number]), axis=1)
    robust, lamp = np.ones_like(weight), np.zeros(3)
    for _ in range(ROUNDS):
        w = weight * robust
        squares = (g * w[:, None]).T @ (g * w[:, None])
        squares += (1e-9 * np.trace(squares) + 1e-300) * np.eye(3)
        lamp = np.linalg.solve(squares, (g * w[:, None]).T @ (values * w))
        off = np.abs(values - g @ lamp) * weight
        robust = np.sqrt(ROBUST.weight(off))
    return lamp


def strengths_check(shading: ShadingSample, found: FittedLamps) -> Check:
    """Whether the lamps are as strong as stated, all alike where nothing is."""
    spread = 100.0 * found.spread
    if not found.uneven:
        said = f"the lamps are as strong beside one another as stated, to {spread:.2g} %"
        mistake, trials = f"a lamp that is {STRONGER:g} times as strong", _stronger_ones(shading.few(), found)
        return good_where_noticed("strengths", said, mistake, trials, HIDDEN)
    far = found.farthest
    return doubtful(
        "strengths",
        f"the lamps differ from the stated strengths by {spread:.2g} % (root mean square), {shading.names[far]} by a "
        f"factor {found.strength[far]:.3g}",
        "measure a rig on other objects (hagoromo calibrate rig) and give --rig, or state them",
    )


def lamps_check(shading: ShadingSample, found: FittedLamps, to_world: Array) -> Check:
    """Whether the direction of a lamp contradicts the others. to_world: (3, 3)."""
    few, direction, wrong = found.even(shading.few()), found.direction, []
    usual = float(np.median(_apart(direction, few.direction)))
    while len(wrong) < MOST_OFF:
        k, moved = _worst(few, direction)
        if k is None:
            break
        wrong.append((k, direction[k], float(_apart(direction, few.direction)[k])))
        few, direction = moved, _directions(moved)
    if not wrong:
        said = f"directions agree with the shading to {usual:.1f}° (median)"
        return good_where_noticed(
            "lamps", said, f"a lamp that is {TURNED_DEG:g}° off", _turned_ones(few, direction), HIDDEN
        )
    said = []
    for k, towards, off in wrong:
        x, y, z = to_world @ towards
        said.append(f"the lamp of {shading.names[k]} is {off:.1f}° off: at ({x:.3f}, {y:.3f}, {z:.3f}) by the others")
    return doubtful("lamps", "; ".join(said), "check its entry, or correct it so")


def _turned_ones(few: ShadingSample, direction: Array) -> Trials:
    """How often a lamp is named that is stated beside where it is, to either side in turn."""
    noticed, turn = [], np.radians(TURNED_DEG)
    for k in tried(len(few.values)):
        stated = few.direction[k]
        aside = np.linalg.svd(stated[None])[2][1 + k % 2]
        turned = few.turned(k, np.cos(turn) * stated + np.sin(turn) * aside)
        noticed.append(_worst(turned, direction)[0] == k)
    return Trials.of(noticed)


def _stronger_ones(few: ShadingSample, plain: FittedLamps) -> Trials:
    """How often a lamp is named that is stronger than stated. plain: the lamps with none that is."""
    noticed = []
    for k in tried(len(few.values)):
        more = np.where(np.arange(len(few.values)) == k, STRONGER, 1.0)
        found = _strengths(replace(few, values=few.values * more[:, None]), 1.0, np.log(plain.strength * more))
        noticed.append(found.uneven and found.farthest == k)
    return Trials.of(noticed)


def _worst(few: ShadingSample, direction: Array) -> tuple[int | None, ShadingSample]:
    """The lamp that is off, and with whose own direction all photographs are explained best, or None; and with it
    moved.
    """
    residual, _ = few.fit()
    best, least, kept = None, np.inf, few
    for k in np.flatnonzero(_apart(direction, few.direction) > OFF_DEG).tolist():
        moved, own = few.turned(k, direction[k]), few.usable[k]
        if loss(residual[k], own) > CONTRADICTS:
            after, _ = moved.fit()
            misfit = loss(after, few.usable)
            evident = _left(residual[k][own], after[k][own]) < OWN_MISFIT
            if misfit < least and evident and _certain(few, k):
                best, least, kept = k, misfit, moved
    return best, kept


def _certain(few: ShadingSample, number: int) -> bool:
    """Whether a lamp is off by far more than its direction changes as parts of the object are left out (jackknife)."""
    count = few.values.shape[1]
    g, part = _by_others(few, number), PARTS * np.arange(count) // count
    lamps = [_lamp(few, number, g)]
    lamps += [_lamp(few.part(part != left_out), number, g[part != left_out]) for left_out in range(PARTS)]
    length = np.maximum(np.linalg.norm(lamps, axis=1, keepdims=True), 1e-300)
    whole, *parts = np.array(lamps) / length - few.direction[number]
    along = parts @ whole / np.linalg.norm(whole)
    return bool(np.linalg.norm(whole) > SURE * np.sqrt((PARTS - 1) * np.var(along)))


def _left(before: Array, after: Array) -> float:
    """Misfit after over that before, of residuals (P,), but for the share LEFT_OUT of them that gains most."""
    was, now = ROBUST.value(before), ROBUST.value(after)
    counted = np.argsort(now - was)[round(LEFT_OUT * len(was)) :]
    return float(now[counted].sum() / max(was[counted].sum(), 1e-300))


def _apart(one: Array, other: Array) -> Array:
    """(K,) angles [°] between unit vectors."""
    return np.degrees(np.arccos(np.clip(np.sum(one * other, axis=1), -1.0, 1.0)))
