"""Trials: a check that finds nothing makes the mistake itself, in some photographs in turn, and counts how often it is
noticed. Where that is seldom, the check says nothing of the photographs.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

MOST = 8  # trials
NOTICED = 0.5  # share of them from which a check that found nothing is good


class Trials(NamedTuple):
    """noticed: in how many of all `tried` the mistake was noticed."""

    noticed: int
    tried: int

    @staticmethod
    def of(noticed: Iterable[bool]) -> Trials:
        """One for each trial."""
        each = [bool(one) for one in noticed]
        return Trials(sum(each), len(each))

    @property
    def enough(self) -> bool:
        """Whether a mistake would be noticed in most photographs."""
        return self.tried > 0 and self.noticed >= NOTICED * self.tried


def tried(count: int) -> list[int]:
    """Numbers of those, of `count`, that a mistake is made in."""
    return np.unique(np.linspace(0, count - 1, min(MOST, count)).round().astype(int)).tolist()
