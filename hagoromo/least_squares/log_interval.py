"""Log interval: bounds of a number above 0 whose logarithm has a normal error. No standard error makes them overflow.

A bound that no float holds is infinite, as the data then set none; an error that is not a number is an infinite one.
"""

from __future__ import annotations

import math
import sys

from hagoromo.least_squares.loss import NORMAL_95

LARGEST_LOGARITHM = math.log(sys.float_info.max)


def exp_or_infinity(logarithm: float) -> float:
    """e to this power; infinity where no float holds it."""
    return math.exp(logarithm) if logarithm < LARGEST_LOGARITHM else math.inf


def log_interval(value: float, relative: float, reach: float = NORMAL_95) -> tuple[float, float]:
    """value · exp(± reach · relative): the bounds of a number, 0 or more, with this standard error of its logarithm."""
    if not value > 0.0:
        return 0.0, 0.0
    middle, half = math.log(value), reach * relative if math.isfinite(relative) else math.inf
    return exp_or_infinity(middle - half), exp_or_infinity(middle + half)
