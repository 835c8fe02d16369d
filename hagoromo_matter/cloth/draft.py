"""Draft: how a cloth is woven, from the loom's threading, tie-up and treadling or as the drawdown that they make.

A drawdown is an array (picks, ends) of bool: True where the end (warp yarn) lies over the pick (weft yarn).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import gcd

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hagoromo.errors import InputError

LARGEST_DRAFT = 4_000_000  # largest number of crossings in a draft
LARGEST_REPEAT = 2000  # largest number of ends of a repeat of as many picks
DIAMOND = ("00100", "01110", "11111", "01110", "00100")  # of a block design


@dataclass(frozen=True, eq=False)
class Draft:
    """One repeat of a weave. drawdown: (picks, ends) bool, True where the warp is up."""

    drawdown: NDArray[np.bool_]

    def __post_init__(self) -> None:
        down = np.asarray(self.drawdown)
        if down.ndim != 2 or down.dtype != bool or not 0 < down.size <= LARGEST_DRAFT:
            raise InputError(
                f"a drawdown of {down.dtype} {down.shape}: give bool (picks, ends), at most {LARGEST_DRAFT}"
            )
        for axis, yarn in enumerate(("end", "pick")):
            loose = np.flatnonzero(down.all(axis=axis) | ~down.any(axis=axis))
            if loose.size:
                raise InputError(
                    f"{yarn} {loose[0] + 1} of the draft stays on one side of all yarns: let it change sides"
                )
        object.__setattr__(self, "drawdown", down)

    @property
    def picks(self) -> int:
        """Weft yarns of a repeat."""
        return self.drawdown.shape[0]

    @property
    def ends(self) -> int:
        """Warp yarns of a repeat."""
        return self.drawdown.shape[1]

    def smallest(self) -> Draft:
        """The smallest repeat of the same weave."""
        return Draft(self.drawdown[: smallest_repeat(self.drawdown), : smallest_repeat(self.drawdown.T)])


def on_loom(threading: Sequence[int], tie_up: ArrayLike, treadling: Sequence[int]) -> Draft:
    """The draft of a loom with a rising shed.

    threading: shaft of every end; tie_up: (treadles, shafts) bool, which shafts a treadle lifts; treadling: treadle of
    every pick. All count from 0.
    """
    lifted = np.asarray(tie_up, bool)
    for name, given, most in (("threading", threading, lifted.shape[1]), ("treadling", treadling, lifted.shape[0])):
        if len(given) == 0 or min(given) < 0 or max(given) >= most:
            raise InputError(f"{name} {list(given)[:8]}: give numbers from 0 to {most - 1}")
    return Draft(lifted[np.asarray(treadling)][:, np.asarray(threading)])


def plain() -> Draft:
    """Plain weave (tabby): over one, under one."""
    return twill(1, 1)


def twill(over: int = 2, under: int = 2) -> Draft:
    """Twill: the warp goes over `over` picks and under `under`; each end does so one pick after its neighbour."""
    if over < 1 or under < 1:
        raise InputError(f"a twill {over}/{under}: give whole numbers from 1 on")
    _check_size(over + under, over + under)
    pick, end = np.mgrid[: over + under, : over + under]
    return Draft((pick - end) % (over + under) < over)


def satin(ends: int = 5, step: int = 0, warp_faced: bool = True) -> Draft:
    """Satin: an end goes under one pick in `ends`; from pick to pick that place moves by `step` ends.

    step 0 takes the smallest that fits (2 for 5 ends, 3 for 8). warp_faced False: the other side (sateen).
    """
    _check_size(ends, ends)
    fitting = [k for k in range(2, ends - 1) if gcd(k, ends) == 1]
    if not fitting or (step and step not in fitting):
        raise InputError(f"a satin of {ends} ends and step {step}: give 5, 7 or more ends, a step among {fitting}")
    pick, end = np.mgrid[:ends, :ends]
    under = end == pick * (step or fitting[0]) % ends
    return Draft(~under if warp_faced else under)


def herringbone(over: int = 2, under: int = 2, width: int = 8) -> Draft:
    """Herringbone: a twill whose line turns every `width` ends, broken there so that no float becomes longer."""
    shafts = over + under
    if width < shafts:
        raise InputError(f"a herringbone {width} ends wide: give at least {shafts}")
    _check_size(shafts, 2 * width)
    up = np.arange(width) % shafts
    threading = np.concatenate([up, (up[-1] + shafts // 2 - np.arange(width)) % shafts])
    return on_loom(threading.tolist(), twill(over, under).drawdown, range(shafts))


def jacquard(pattern: Sequence[str] = DIAMOND, ends: int = 5) -> Draft:
    """Jacquard block: a figure in weft-faced satin ("1" in the rows of `pattern`, top first) on warp-faced satin.

    Each character stands for one repeat of the satin.
    """
    rows = [[sign == "1" for sign in row] for row in pattern]
    if not rows or len({len(row) for row in rows}) != 1 or not set("".join(pattern)) <= {"0", "1"}:
        raise InputError(f"a pattern {list(pattern)[:4]}: give rows of equal length made of 0 and 1")
    _check_size(len(rows) * ends, len(rows[0]) * ends)
    figure = np.kron(np.array(rows[::-1]), np.ones((ends, ends), bool))
    shape = (len(rows), len(rows[0]))
    faces = [np.tile(satin(ends, warp_faced=face).drawdown, shape) for face in (False, True)]
    return Draft(np.where(figure, *faces))


def _check_size(picks: int, ends: int) -> None:
    """Raise `InputError` for a draft of more crossings than it may have, before it is made."""
    if picks * ends > LARGEST_DRAFT:
        raise InputError(f"a draft of {picks} picks and {ends} ends: at most {LARGEST_DRAFT} crossings, give fewer")


def smallest_repeat(rows: NDArray) -> int:
    """The smallest number of rows after which the array repeats."""
    count = len(rows)
    fitting = (n for n in range(1, count + 1) if count % n == 0 and (rows == np.roll(rows, n, axis=0)).all())
    return next(fitting)
