"""Smooth share: how much of the own variance of each normal is left where normals of neighbours were smoothed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Stiffness:
    """λ [rad⁻²] of `smooth_normals`, and the gain: share of the squared distance between normals of both halves of the
    lamps that it takes off.
    """

    value: float
    gain: float

    def remark(self) -> str:
        """What was done and why."""
        return (
            f"normals are those of a smooth surface: of half of the lamps they predict the other half's normals "
            f"{100.0 * self.gain:.0f} % better"
        )


@dataclass(frozen=True, eq=False)
class SmoothShare:
    """stiffness: how smooth the surface is. share: (P,) of the own variance that is left. variance: (P,) [rad²] of the
    normals when they were smoothed, by which they are weighed.

    What is left is alike in neighbours: in means over many pixels it counts as the variance before.
    """

    stiffness: Stiffness
    share: Array
    variance: Array

    def pixels(self, chosen: NDArray) -> SmoothShare:
        """That of some pixels."""
        return SmoothShare(self.stiffness, self.share[chosen], self.variance[chosen])
