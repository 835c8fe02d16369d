"""Sheet: a piece of cloth at rest in space: a grid of points with their coordinates on the cloth. Lengths in mm."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError

BYTES_PER_POINT = 150.0  # memory of a point of a sheet while it is laid


@dataclass(frozen=True, eq=False)
class Sheet:
    """A grid of points (rows, columns, 3); rows run along u, columns along v, the upper side is u × v.

    u, v: (rows, columns), coordinates on the cloth. around: width of a tube, whose last column is next to its first,
    where u is larger by that width; 0: the sheet is open.
    """

    points: NDArray[np.float64]
    u: NDArray[np.float64]
    v: NDArray[np.float64]
    around: float = 0.0

    def __post_init__(self) -> None:
        shape = self.points.shape
        if len(shape) != 3 or shape[2] != 3 or min(shape[:2]) < 4 or not np.isfinite(self.points).all():
            raise InputError(f"points of a sheet are {shape}: give (rows, columns, 3) finite numbers, 4 × 4 or more")
        if self.u.shape != shape[:2] or self.v.shape != shape[:2]:
            raise InputError(f"u and v of a sheet are {self.u.shape} and {self.v.shape}: give {shape[:2]} like points")

    @property
    def spacing(self) -> float:
        """Mean distance of neighbours, along rows or columns, whichever is more [mm]."""
        steps = (np.linalg.norm(np.diff(self.points, axis=axis), axis=2) for axis in (0, 1))
        return max(float(step.mean()) for step in steps)

    def refined(self, times: int) -> Sheet:
        """The same sheet on `times` as many rows and columns, smooth (cubic splines through the points)."""
        rows, columns = self.points.shape[:2]
        down = np.linspace(0.0, rows - 1.0, (rows - 1) * times + 1)
        if self.around:
            across = np.arange(columns * times) / times
        else:
            across = np.linspace(0.0, columns - 1.0, (columns - 1) * times + 1)
        return self.resampled(down, across)

    def resampled(self, down: NDArray[np.float64], across: NDArray[np.float64]) -> Sheet:
        """The sheet at fractional rows `down` and columns `across` of its grid."""
        from scipy.interpolate import CubicSpline

        values = np.concatenate([self.points, self.u[..., None], self.v[..., None]], axis=2)
        if self.around:  # closed: u becomes periodic when its mean growth is taken out
            grown = self.around * np.arange(self.u.shape[1] + 1) / self.u.shape[1]
            values = np.concatenate([values, values[:, :1]], axis=1)
            values[:, -1, 3] += self.around
            values[..., 3] -= grown
            spline = CubicSpline(np.arange(len(grown)), values, axis=1, bc_type="periodic")
        else:
            spline = CubicSpline(np.arange(self.u.shape[1]), values, axis=1, bc_type="natural")
        wide = spline(across)
        if self.around:
            wide[..., 3] += self.around * across / self.u.shape[1]
        fine = CubicSpline(np.arange(len(wide)), wide, axis=0, bc_type="natural")(down)
        return Sheet(fine[..., :3], fine[..., 3], fine[..., 4], self.around)

    def faces(self) -> NDArray[np.int64]:
        """Triangles of the grid, (m, 3) indices of points anticlockwise as seen from the upper side."""
        rows, columns = self.points.shape[:2]
        index = np.arange(rows * columns).reshape(rows, columns)
        if self.around:
            index = np.concatenate([index, index[:, :1]], axis=1)
        a, b, c, d = (part.ravel() for part in (index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]))
        return np.concatenate([np.stack([a, b, d], axis=1), np.stack([a, d, c], axis=1)])
