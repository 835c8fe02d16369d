"""Weave: yarns interlaced after a draft, as paths through one period of the cloth. All in mm.

Warp yarns run along v, side by side along u; weft yarns (picks) run along u. Heights count from the cloth's middle.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.memory import require
from hagoromo_matter.cloth.draft import Draft, plain, satin, twill
from hagoromo_matter.cloth.strand import Paths
from hagoromo_matter.cloth.wander import freedom, wander, wandered
from hagoromo_matter.cloth.yarn import Yarn, check_yarn

FEWEST, ENOUGH, MOST = 8, 10, 256  # yarns of a period in each direction: least, preferred least, most
STEPS_PER_DIAMETER = 8  # steps of a path per diameter
POINTS_PER_CROSSING = 64  # points between crossings from which a path is interpolated
POPULATIONS = 4


class Woven(NamedTuple):
    """A woven cloth: draft, yarns per cm, the yarns, and how they lie.

    crimp: share of the warp in rising and falling (1: the weft lies straight). uneven: spread of the yarns' places, of
    their distance. warp_colours, weft_colours: numbers of the colours of neighbouring yarns, repeated. Yarns
    are twisted by the whole number of turns in a period that is nearest to their twist.
    """

    draft: Draft = plain()
    warp_per_cm: float = 16.0
    weft_per_cm: float = 15.0
    warp: Yarn = Yarn()
    weft: Yarn = Yarn()
    crimp: float = 0.5
    uneven: float = 0.025
    warp_colours: tuple[int, ...] = (0,)
    weft_colours: tuple[int, ...] = (0,)

    @property
    def pitch(self) -> tuple[float, float]:
        """Distance between neighbouring warp yarns and between neighbouring weft yarns [mm]."""
        return 10.0 / self.warp_per_cm, 10.0 / self.weft_per_cm

    @property
    def thickness(self) -> float:
        """Between the outermost sides of the yarns [mm]."""
        swing = self.warp.thickness_mm + self.weft.thickness_mm
        return max(self.crimp * swing + self.warp.thickness_mm, (1 - self.crimp) * swing + self.weft.thickness_mm)

    @property
    def palette(self) -> tuple[tuple[int, int], ...]:
        """Set (0 warp, 1 weft) and colour of every population, in the order of their numbers."""
        pairs = [(0, self.warp_colours[0]), (1, self.weft_colours[0])]
        pairs += [(k, colour) for k, many in enumerate((self.warp_colours, self.weft_colours)) for colour in many]
        return tuple(dict.fromkeys(pairs))


def check_woven(cloth: Woven) -> Woven:
    """`cloth`, or `InputError` in one line where it cannot be woven."""
    for key in ("warp_per_cm", "weft_per_cm"):
        if not (math.isfinite(getattr(cloth, key)) and getattr(cloth, key) > 0):
            raise InputError(f"{key} is {getattr(cloth, key)}: give a number above 0")
    for key, most in (("crimp", 1.0), ("uneven", 0.2)):
        if not 0 <= getattr(cloth, key) <= most:
            raise InputError(f"{key} is {getattr(cloth, key)}: give a number from 0 to {most:g}")
    if not cloth.warp_colours or not cloth.weft_colours:
        raise InputError("warp_colours or weft_colours are empty: give the colour of one yarn at least")
    if len(cloth.palette) > POPULATIONS:
        raise InputError(f"{len(cloth.palette)} colours of warp and weft yarns: give {POPULATIONS} in all at most")
    for name, yarn, pitch in zip(("warp", "weft"), (cloth.warp, cloth.weft), cloth.pitch, strict=True):
        check_yarn(yarn, f"{name} yarn")
        if yarn.width_mm > pitch:
            raise InputError(
                f"{name} yarns {yarn.width_mm:.3g} mm wide do not fit at {name}_per_cm {10 / pitch:g}: "
                f"give at most {10 / yarn.width_mm:.3g}"
            )
    for k in (0, 1):
        _bend(cloth, k)
    counts = tuple(_yarns(cloth, k) for k in (0, 1))
    if max(counts) > MOST:
        raise InputError(f"the draft with its colours repeats after {counts} yarns: give one of {MOST} at most")
    return cloth


def period_of(cloth: Woven) -> tuple[float, float]:
    """Lengths along u and v after which the cloth repeats [mm]."""
    return tuple(_yarns(cloth, k) * cloth.pitch[k] for k in (0, 1))  # type: ignore[return-value]


def woven_paths(cloth: Woven, margin: float, variants: int, seed: int) -> tuple[Paths, Paths]:
    """Paths of the warp and of the weft; within `margin` [mm] of the border of the period all variants agree.

    `InputError` where a period has more of them than the memory holds.
    """
    require(sum(_points(cloth, k) for k in (0, 1)) * (60.0 + 50.0 * variants), "the yarns of a period of the cloth")
    return _paths(cloth, 0, margin, variants, seed), _paths(cloth, 1, margin, variants, seed)


def _points(cloth: Woven, k: int) -> float:
    """Points of all paths of the warp (k = 0) or the weft (k = 1), between crossings and along the yarn."""
    steps = period_of(cloth)[1 - k] / (cloth.warp, cloth.weft)[k].diameter_mm * STEPS_PER_DIAMETER
    return _yarns(cloth, k) * (float(_yarns(cloth, 1 - k)) * POINTS_PER_CROSSING + steps)


def _paths(cloth: Woven, k: int, margin: float, variants: int, seed: int) -> Paths:
    """Paths of the warp (k = 0) or the weft (k = 1)."""
    yarn, pitch, period = (cloth.warp, cloth.weft)[k], cloth.pitch, period_of(cloth)
    sides, drawn = _sides(cloth, k), np.random.default_rng((seed, k))
    own = np.random.default_rng((seed, k, 1))
    yarns, along = (
        sides.shape[0],
        np.arange(sides.shape[1] * POINTS_PER_CROSSING + 1) * (pitch[1 - k] / POINTS_PER_CROSSING),
    )
    straight = np.zeros((yarns, along.size, 3))
    straight[..., k] = ((np.arange(yarns) + 0.5) * pitch[k])[:, None]
    straight[..., 1 - k] = along
    straight[..., 2] = _heights(cloth, k, sides)
    length = float(np.linalg.norm(np.diff(straight, axis=1), axis=-1).sum(axis=1).mean())
    free = freedom(straight[:, :-1], period, margin)
    varied = wander(yarn, free, length, variants, (drawn, own))
    room = min(cloth.uneven, max(0.0, 0.5 - 0.5 * yarn.width_mm / pitch[k]))
    beside = np.zeros_like(straight)
    beside[..., k] = room * pitch[k]
    turns, steps = round(yarn.rates[0] * length / (2.0 * np.pi)), round(length / yarn.diameter_mm * STEPS_PER_DIAMETER)
    colours = np.resize((cloth.warp_colours, cloth.weft_colours)[k], yarns)
    population = np.array([cloth.palette.index((k, int(colour))) for colour in colours])
    population = np.repeat(population[:, None], steps, axis=1)
    return Paths(**wandered(straight, beside, varied, turns, steps), turns=turns, population=population)


def _sides(cloth: Woven, k: int) -> NDArray[np.float64]:
    """1 where yarns of the set are above, −1 below: (yarns of the set, crossings of each) in a period."""
    down = cloth.draft.drawdown
    tiled = np.tile(down, (-(-_yarns(cloth, 1) // down.shape[0]), -(-_yarns(cloth, 0) // down.shape[1])))
    up = tiled[: _yarns(cloth, 1), : _yarns(cloth, 0)]
    return np.where(up.T if k == 0 else ~up, 1.0, -1.0)


def _heights(cloth: Woven, k: int, sides: NDArray) -> NDArray[np.float64]:
    """Heights of paths [mm]: an arc around the crossing yarn, then straight to the next; POINTS_PER_CROSSING each.

    Peirce, "The geometry of cloth structure", J. Text. Inst. 28, 1937; flattened yarns as Kemp, ibid. 49, 1958.
    """
    pitch, swing, (angle, flat) = cloth.pitch[1 - k], _swing(cloth, k), _bend(cloth, k)
    radius = 0.5 * (cloth.warp.thickness_mm + cloth.weft.thickness_mm)
    at = np.arange(sides.shape[1] * POINTS_PER_CROSSING + 1) / POINTS_PER_CROSSING
    crossing = np.floor(at).astype(int)
    offset = at - crossing - 0.5  # pitches from the middle of the crossing yarn
    here = sides[:, crossing % sides.shape[1]]
    next_ = sides[:, (crossing + np.where(offset < 0, -1, 1)) % sides.shape[1]]
    away = np.maximum(np.abs(offset) * pitch - 0.5 * flat, 0.0)
    arc, foot = radius - np.sqrt(np.maximum(radius**2 - away**2, 0.0)), radius * math.sin(angle)
    drop = np.where(away < foot, arc, radius * (1 - math.cos(angle)) + (away - foot) * math.tan(angle))
    return here * np.where(here == next_, swing, swing - drop)


def _swing(cloth: Woven, k: int) -> float:
    """How far yarns of a set rise above the middle of the cloth [mm]: touching where they cross."""
    share = (cloth.crimp, 1.0 - cloth.crimp)[k]
    return 0.5 * share * (cloth.warp.thickness_mm + cloth.weft.thickness_mm)


def _bend(cloth: Woven, k: int) -> tuple[float, float]:
    """Steepest angle of the yarns of a set [rad] and the flat top of the yarns that they cross [mm].

    Peirce's p sin θ + (D − h) cos θ = D, for p, D and h given; flattened yarns give way where p is short.
    """
    crossed, pitch = (cloth.weft, cloth.warp)[k], cloth.pitch[1 - k]
    both = cloth.warp.thickness_mm + cloth.weft.thickness_mm
    left = both - 2.0 * _swing(cloth, k)
    least = math.sqrt(max(both**2 - left**2, 0.0))
    if pitch < least:
        raise InputError(
            f"yarns of {cloth.warp.diameter_mm:g} and {cloth.weft.diameter_mm:g} mm jam at "
            f"{('weft', 'warp')[k]}_per_cm {10 / pitch:g}: give at most {10 / least:.3g}, thinner or flatter yarns"
        )
    flat = min(crossed.width_mm - crossed.thickness_mm, pitch - least)
    return math.asin(min(both / math.hypot(pitch - flat, left), 1.0)) - math.atan2(left, pitch - flat), flat


def _yarns(cloth: Woven, k: int) -> int:
    """Warp (k = 0) or weft yarns of a period: as many repeats as let the twist of the yarns across end whole."""
    repeat = (cloth.draft.ends, cloth.draft.picks)[k]
    repeat = math.lcm(repeat, len((cloth.warp_colours, cloth.weft_colours)[k]))
    fewest = max(1, -(-FEWEST // repeat))
    rate = (cloth.weft, cloth.warp)[k].twist_per_cm * 0.1 * cloth.pitch[k] * repeat  # turns in a repeat, about

    def missed(count: int) -> float:
        return abs(round(rate * count) - rate * count) / (rate * count) if rate else 0.0

    return repeat * min(range(fewest, max(fewest, ENOUGH // repeat) + 1), key=missed)


_FLAX = Yarn(0.34, 1.2, 1, 5.5, "Z", 0.0, 150, 18.0, 0.15, 12.0, 0.6, 0.08, 0.2)
_WORSTED = Yarn(0.46, 1.1, 2, 5.0, "S", 6.0, 65, 21.0, 0.15, 14.0, 0.8, 0.05, 0.02)
_ORGANZINE = Yarn(0.095, 1.6, 2, 6.0, "S", 0.0, 11, 11.0, 0.08, 0.0, 0.0, 0.02, 0.0)
_TRAM = Yarn(0.11, 1.8, 1, 1.5, "Z", 0.0, 58, 11.0, 0.1, 0.0, 0.0, 0.03, 0.0)
LINEN = Woven(plain(), 16.0, 15.0, _FLAX, _FLAX)
WOOL = Woven(twill(2, 2), 13.5, 13.0, _WORSTED, _WORSTED)
SILK = Woven(satin(8), 62.0, 40.0, _ORGANZINE, _TRAM, 0.4, 0.015)
