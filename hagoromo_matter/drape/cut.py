"""Cut: a piece of cloth before it is draped: its size, its initial place, and what holds it. Lengths in mm.

Positions on it are shares s along u and t along v, 0…1; functions of them take and return arrays.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.memory import require
from hagoromo_matter.drape.sheet import BYTES_PER_POINT, Sheet

Place = NDArray[np.float64]
LEAST_POINTS_PER_EDGE = 6  # least number of points along an edge


def _nowhere(s: Place, t: Place) -> Place:
    return np.zeros(np.broadcast(s, t).shape)


def _free(s: Place, t: Place) -> Place:
    return np.full(np.broadcast(s, t).shape, np.inf)


@dataclass(frozen=True)
class Cut:
    """A piece of `width` × `height` at rest, a tube if `closed`; start(s, t) → (…, 3) is its initial place.

    narrowing(t): width of a row, of `width` (gathers that were cut, not folded: u is stretched as much).
    reach(s, t): largest distance of points from the body; a finite reach draws them in, as a belt does.
    held(s, t) > 0: points that stay at their initial place, or where they come within reach. layer: the number of the
    body it lies on. apart(s, t) > 0: points that may pass through other pieces.
    """

    width: float
    height: float
    start: Callable[[Place, Place], NDArray[np.floating]]
    closed: bool = False
    narrowing: Callable[[Place], Place] = lambda t: np.ones_like(t)
    held: Callable[[Place, Place], Place] = _nowhere
    reach: Callable[[Place, Place], Place] = _free
    layer: int = 0
    apart: Callable[[Place, Place], Place] = _nowhere

    def __post_init__(self) -> None:
        if not (np.isfinite([self.width, self.height]).all() and min(self.width, self.height) > 0):
            raise InputError(f"a cloth of {self.width:g} × {self.height:g} mm: give finite sizes above 0")

    def shares(self, spacing: float) -> tuple[Place, Place]:
        """Shares s (columns) and t (rows) of a grid with about `spacing` between its points."""
        if spacing > 0.5 * min(self.width, self.height):
            raise InputError(
                f"points {spacing:g} mm apart on a cloth of {self.width:g} × {self.height:g} mm: "
                "give a spacing of at most half its shorter edge"
            )
        count = (self.width / spacing + 1.0) * (self.height / spacing + 1.0)
        require(BYTES_PER_POINT * count, f"a cloth of {self.width:g} × {self.height:g} mm")
        columns, rows = round(self.width / spacing) + (not self.closed), round(self.height / spacing) + 1
        columns, rows = max(columns, LEAST_POINTS_PER_EDGE), max(rows, LEAST_POINTS_PER_EDGE)
        return np.linspace(0.0, 1.0, columns, endpoint=not self.closed), np.linspace(0.0, 1.0, rows)

    def sheet(self, spacing: float, before: Sheet | None = None) -> Sheet:
        """The piece at its initial place, or where a coarser sheet of it lies."""
        s, t = self.shares(spacing)
        if before is not None:
            rows, columns = before.points.shape[:2]
            return before.resampled(t * (rows - 1), s * (columns if self.closed else columns - 1))
        u, v = np.broadcast_arrays(s * self.width, t[:, None] * self.height)
        start = np.asarray(self.start(s[None, :], t[:, None]), float)
        return Sheet(start, u.copy(), v.copy(), self.width if self.closed else 0.0)

    def narrow(self, s: Place, t: Place) -> Place:
        """narrowing(t) as a function of both."""
        return self.narrowing(t) + np.zeros_like(s)

    def over(self, values: Callable[[Place, Place], Any], spacing: float) -> NDArray[np.float64]:
        """A function of (s, t) at the points of the grid: (rows, columns)."""
        s, t = self.shares(spacing)
        return np.broadcast_to(np.asarray(values(s[None, :], t[:, None]), float), (len(t), len(s)))
