"""Wander: random variation between the yarns of a cloth and along them: girth, place and twist.

The variation repeats with the period of the cloth; variants of a period differ inside and are equal at its border.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo_matter.cloth.yarn import Yarn

WANDER_WAVES = 1, 2, 3, 5  # per period, of the variation along a yarn
MOST_DRAWN = 1_000_000  # slubs or fly-away fibres of a period
SLUB = 0.33, 2.0  # additional girth of a slub [girths], and its length [diameters]
TWIST = 0.3  # [rad] standard deviation of the twist


class Wander(NamedTuple):
    """Of yarns at equal steps along them, (variants, yarns, steps): girth of the diameter, place to the side of its
    standard deviation, phase [rad].
    """

    girth: NDArray[np.float64]
    aside: NDArray[np.float64]
    phase: NDArray[np.float64]


def wander(yarn: Yarn, free: NDArray, length: float, variants: int, draws: tuple[np.random.Generator, ...]) -> Wander:
    """The variation of yarns of `length` [mm]. free: (yarns, steps), 0 where variants are equal, 1 where independent.

    draws: a generator for what all variants share, and one for what each has alone.
    """
    shared, own = draws
    yarns, steps = free.shape
    check_drawn(0.1 * yarn.slubs_per_cm * length * yarns * variants, "slubs")
    way = np.arange(steps) / steps

    def varied() -> NDArray:
        both = _waves(shared, yarns, way) + np.zeros((variants, 1, 1))
        return np.sqrt(1.0 - 0.5 * free**2) * both + np.sqrt(0.5) * free * np.stack(
            [_waves(own, yarns, way) for _ in range(variants)]
        )

    girth, aside, phase = 1.0 + yarn.uneven * varied(), varied(), TWIST * varied()
    for each, inner in zip(girth.reshape(-1, steps), np.tile(free, (variants, 1)), strict=True):
        for _ in range(own.poisson(0.1 * yarn.slubs_per_cm * length)):
            away = (way - own.random() + 0.5) % 1.0 - 0.5
            each += SLUB[0] * np.exp(-((away * length / (SLUB[1] * yarn.diameter_mm)) ** 2)) * inner
    start = 2.0 * np.pi * shared.random((yarns, 1))
    return Wander(girth / np.sqrt((girth**2).mean()), aside, phase + start)


def check_drawn(count: float, what: str) -> None:
    """Raise `InputError` for more things on the yarns of a period than are drawn one by one; what: their name."""
    if not count <= MOST_DRAWN:
        raise InputError(f"the yarns of a period have {count:.3g} {what}, at most {MOST_DRAWN} are drawn: give fewer")


def freedom(points: NDArray, period: tuple[float, float], margin: float) -> NDArray:
    """0 within `margin` [mm] of the border of the period, rising to 1 twice as far inside: of points (…, 3)."""
    away = np.minimum(points[..., :2] % period, -points[..., :2] % period).min(axis=-1)
    share = np.clip((away - margin) / margin, 0.0, 1.0)
    return share * share * (3.0 - 2.0 * share)


def wandered(base: NDArray, beside: NDArray, varied: Wander, turns: int, count: int) -> dict[str, NDArray]:
    """Yarns at `count` equal steps of their own length: points, girth, phase [rad] and way (0 to 1 along the base).

    base: paths (yarns, n + 1, 3) whose last point begins the next period [mm]; beside: how they are moved aside, of
    the same shape [mm]; turns: of the twist. Where variants have the same path they have the same phase and way.
    """
    rows = []
    for girth, aside, phase in zip(*varied, strict=True):  # of a variant
        for k, path in enumerate(base):
            way = length_along(path) / length_along(path)[-1]
            moved = path + beside[k] * np.append(aside[k], aside[k, 0])[:, None]
            turned = np.append(phase[k], phase[k, 0]) + 2.0 * np.pi * turns * way
            table = np.column_stack([moved, np.append(girth[k], girth[k, 0]), turned, way])
            length = length_along(moved)
            at = np.arange(count) * (length[-1] / count)
            rows.append(np.stack([np.interp(at, length, column) for column in table.T], axis=-1))
    samples = np.array(rows).reshape(len(varied.girth), len(base), count, -1)
    return {"points": samples[..., :3], "girth": samples[..., 3], "phase": samples[..., 4], "way": samples[..., 5]}


def length_along(path: NDArray) -> NDArray[np.float64]:
    """Length of a path (n, 3) up to each of its points."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])


def _waves(draw: np.random.Generator, yarns: int, way: NDArray) -> NDArray:
    """Sums of waves of random phase, mean 0 and variance 1 along every yarn: (yarns, steps)."""
    phase = draw.random((len(WANDER_WAVES), yarns, 1))
    turns = np.array(WANDER_WAVES)[:, None, None] * way
    return np.sqrt(2.0 / len(WANDER_WAVES)) * np.sin(2.0 * np.pi * (turns + phase)).sum(axis=0)
