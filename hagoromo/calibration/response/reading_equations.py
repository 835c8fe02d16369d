"""The equations of a curve: readings as weighted integrals of it, and the covariance of their errors.

An error has a part of each reading, and a part that all readings of a group share, such as an error of the strength of
a lamp that lit all of its patches: ρ = (1 + g) M R + noise, with one g per group.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

LEAST_NOISE = 1e-5  # least relative noise of a reading
Array = NDArray[np.float64]
Rows = NDArray[np.intp]


class ReadingNoise(NamedTuple):
    """Standard deviations: relative to a reading; of any reading, over the mean one; and of the shared factor g."""

    relative: float
    floor: float
    shared: float = 0.0


class Groups(NamedTuple):
    """Readings that share an error. labels: (m,) from 0. expected: (m,) readings without it, to first order."""

    labels: Rows
    expected: Array

    @property
    def count(self) -> int:  # pyrefly: ignore[bad-override]
        """Number of groups."""
        return int(self.labels.max()) + 1


class Inverse(NamedTuple):
    """The inverse V⁻¹ of the covariance of the readings' errors, and ln det V.

    V = diag(1/weight) + shared² Σ_k u_k u_kᵀ, u_k the expected readings of group k (Woodbury's identity).
    pull: (m, groups).
    """

    weight: Array
    pull: Array
    log_determinant: float

    def times(self, columns: Array) -> Array:
        """V⁻¹ columns, (m,) or (m, k)."""
        weighted = (self.weight * columns.T).T
        return weighted - self.pull @ (self.pull.T @ columns) if self.pull.shape[1] else weighted


class ReadingEquations(NamedTuple):
    """readings (m,) = matrix (m, n) R, both scaled so that R = 1 gives readings of mean 1.

    wavelengths: (n,) [nm]. rounding: variance of the readings by rounding. unit: of R. groups: None: no shared errors.
    """

    matrix: Array
    readings: Array
    wavelengths: Array
    rounding: float
    unit: float
    groups: Groups | None = None

    @staticmethod
    def scaled(wavelengths: Array, matrix: Array, readings: Array, rounding: float = 0.0) -> ReadingEquations:
        """From a matrix and readings in any units; the readings have a mean above 0."""
        size, level = matrix.sum(axis=1).mean(), max(float(readings.mean()), 1e-300)
        return ReadingEquations(matrix / size, readings / level, wavelengths, rounding / level**2, level / size)

    @property
    def noises(self) -> int:
        """Number of figures that `ReadingNoise` has here."""
        return 2 if self.groups is None else 3

    def linearised(self, power: float, offset: float) -> ReadingEquations:
        """With readings that are proportional to light, if they were ρ^power + offset."""
        return self._replace(readings=np.maximum(self.readings - offset, 1e-6) ** (1.0 / power))

    def inverse(self, noise: ReadingNoise) -> Inverse:
        """Of the covariance of the errors: (relative · reading)² + floor² + rounding, and what groups share."""
        least = LEAST_NOISE**2
        variance = (noise.relative**2 + least) * self.readings**2 + noise.floor**2 + least + self.rounding
        weight, log = 1.0 / variance, float(np.log(variance).sum())
        if self.groups is None or noise.shared <= 0.0:
            return Inverse(weight, np.zeros((len(weight), 0)), log)
        labels, expected = self.groups
        ratio = 1.0 + noise.shared**2 * np.bincount(labels, weight * expected**2, self.groups.count)
        pull = np.zeros((len(weight), self.groups.count))
        pull[np.arange(len(weight)), labels] = weight * expected * (noise.shared / np.sqrt(ratio))[labels]
        return Inverse(weight, pull, log + float(np.log(ratio).sum()))

    def normal(self, inverse: Inverse) -> Normal:
        """The sums from which the cost of every curve follows; the number of readings does not enter after that."""
        towards = inverse.times(self.matrix)
        return Normal(
            self.matrix.T @ towards, towards.T @ self.readings, float(self.readings @ inverse.times(self.readings))
        )

    def where(self, rows: Rows) -> ReadingEquations:
        """The readings of some rows, without what they share with others."""
        return self._replace(matrix=self.matrix[rows], readings=self.readings[rows], groups=None)


class Normal(NamedTuple):
    """(M R − ρ)ᵀ V⁻¹ (M R − ρ) = Rᵀ A R − 2 b R + c."""

    square: Array
    linear: Array
    constant: float

    def misfit(self, curve: Array) -> float:
        """(M R − ρ)ᵀ V⁻¹ (M R − ρ)."""
        return float(curve @ self.square @ curve - 2.0 * self.linear @ curve + self.constant)
