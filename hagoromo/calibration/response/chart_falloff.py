"""Falloff of the light over a photographed chart, and the photograph that contradicts the others.

A lamp near a chart lights one side more than the other. Readings divided by the falloff are what the patches' spectra
explain, so both are fitted together: ln falloff is a polynomial of second degree over the chart, with mean 0, one for
each photograph and common to its channels.

A cause that changes the readings of all channels alike, such as light that falls off over a chart.

Enters: readings of all channels, and what they change by. Leaves: how large the cause is, with the curves free.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.calibration.response.curve_evidence import DIVERGED, Found, most_evidence
from hagoromo.calibration.response.curve_prior import CurvePrior
from hagoromo.calibration.response.reading_equations import ReadingEquations
from hagoromo.errors import InputError

FALLOFF_PRIOR = 0.2  # standard deviation of each coefficient of ln falloff, over half of the chart
FALLOFF_FITS = 3  # of the curves and the falloff in turn
CERTAIN_FALLOFF = 30.0  # fall of χ² per photograph, of five coefficients: p < 2e-5
LEAST_FALLOFF = 0.005  # share of the light; less is neither reported nor corrected
DOUBTFUL_MISFIT = 0.02  # of the readings, relative, from which a photograph at fault is looked for
MISFIT_RATIO = 0.5  # largest misfit without the photograph at fault, relative to that with it
Array = NDArray[np.float64]


class ChartReadings(NamedTuple):
    """Readings of a chart in several photographs, in rows of one table.

    wavelengths: (n,) [nm]. matrix: (m, n). readings: channel → (m,), NaN where clipped. photograph, patch: (m,).
    """

    wavelengths: Array
    matrix: Array
    readings: dict[str, Array]
    photograph: NDArray[np.intp]
    patch: NDArray[np.intp]

    def without(self, photograph: int) -> ChartReadings:
        """The readings of all other photographs."""
        return self.where(self.photograph != photograph)

    def where(self, rows: NDArray[np.bool_]) -> ChartReadings:
        """The readings of some rows."""
        readings = {name: reading[rows] for name, reading in self.readings.items()}
        return ChartReadings(self.wavelengths, self.matrix[rows], readings, self.photograph[rows], self.patch[rows])

    def divided(self, share: Array) -> ChartReadings:
        """With readings divided by `share` (m,)."""
        return self._replace(readings={name: reading / share for name, reading in self.readings.items()})


def falloff(chart: ChartReadings, priors: Mapping[str, Sequence[CurvePrior]]) -> Array:
    """(m,): light at each reading relative to the mean of its photograph; 1 where it is not certainly uneven."""
    basis = _basis(chart)
    coefficients = np.zeros(basis.shape[1])
    cause, known = None, {}
    for k in range(FALLOFF_FITS):
        known = known if k != FALLOFF_FITS - 1 else {}  # the last with the noise that is left
        even = chart.divided(np.exp(basis @ coefficients))
        cause = common_cause(even.wavelengths, even.matrix, even.readings, priors, basis, known)
        step = np.linalg.solve(
            cause.precision + np.eye(len(coefficients)) / FALLOFF_PRIOR**2,
            cause.gradient - coefficients / FALLOFF_PRIOR**2,
        )
        coefficients = coefficients + step
    return _certain(basis, coefficients, cause, int(chart.photograph.max()) + 1)


def _certain(basis: Array, coefficients: Array, cause: Cause | None, count: int) -> Array:
    """exp(basis · coefficients) of the photographs whose falloff is certain and matters."""
    kept = np.zeros_like(coefficients)
    for k in range(count):
        own = slice(5 * k, 5 * (k + 1))
        part = np.zeros_like(coefficients)
        part[own] = coefficients[own]
        certain = cause is not None and part @ cause.precision @ part > CERTAIN_FALLOFF
        if certain and np.ptp(np.exp(basis @ part)) > LEAST_FALLOFF:
            kept += part
    return np.exp(basis @ kept)


def _basis(chart: ChartReadings) -> Array:
    """(m, 5 · photographs): x, y, x², x y, y² over the chart of 6 × 4 patches, each of mean 0."""
    row, column = np.divmod(np.arange(24), 6)
    x, y = (column - 2.5) / 2.5, (row - 1.5) / 1.5
    terms = np.stack([x, y, x**2, x * y, y**2], axis=1)
    terms -= terms.mean(axis=0)
    basis = np.zeros((len(chart.patch), 5 * (int(chart.photograph.max()) + 1)))
    for k in range(int(chart.photograph.max()) + 1):
        own = chart.photograph == k
        basis[own, 5 * k : 5 * (k + 1)] = terms[chart.patch[own]]
    return basis


def falloff_findings(chart: ChartReadings, share: Array, names: Sequence[str]) -> list[str]:
    """A sentence for each photograph whose light is uneven."""
    said = []
    for k, name in enumerate(names):
        own = share[chart.photograph == k]
        if len(own) and np.ptp(own) > LEAST_FALLOFF:
            said.append(
                f"{name}: the light differs by {100 * (own.max() / own.min() - 1.0):.0f} % over the chart: corrected"
            )
    return said


def photograph_at_fault(
    chart: ChartReadings, priors: Mapping[str, Sequence[CurvePrior]], names: Sequence[str]
) -> list[str]:
    """A sentence that names the photograph without which the others agree, if the readings do not."""
    count = len(names)
    misfit = _misfit(chart, priors) if count > 1 else 0.0
    if misfit < DOUBTFUL_MISFIT:
        return []
    without = [_misfit(chart.without(k), priors) for k in range(count)]
    best = int(np.argmin(without))
    others = [of for k, of in enumerate(without) if k != best]
    if without[best] > MISFIT_RATIO * misfit:
        return [f"the photographs do not fit the spectra to {100 * misfit:.0f} %, and none of them alone is the cause"]
    if without[best] > MISFIT_RATIO * min(others):
        pair = " and ".join(str(names[k]) for k in np.argsort(without)[:2].tolist())
        return [f"{pair} contradict each other by {100 * misfit:.0f} %: check the lamps' spectra and the exposures"]
    return [
        f"{names[best]} contradicts the others: without it the readings fit to {100 * without[best]:.1f} %, with it to "
        f"{100 * misfit:.1f} %: check its lamp's spectrum, its exposure and its chart's corners"
    ]


def _misfit(chart: ChartReadings, priors: Mapping[str, Sequence[CurvePrior]]) -> float:
    """Root mean square of the relative residuals over all channels."""
    none = np.zeros((len(chart.patch), 0))
    cause = common_cause(chart.wavelengths, chart.matrix, chart.readings, priors, none)
    return float(np.sqrt(np.mean(cause.residual**2)))


class Cause(NamedTuple):
    """Precision (k, k) and gradient (k,) of ½ χ² in the coefficients of a cause; relative residuals of all readings."""

    precision: Array
    gradient: Array
    residual: Array


def common_cause(
    wavelengths: Array,
    matrix: Array,
    readings: Mapping[str, Array],
    priors: Mapping[str, Sequence[CurvePrior]],
    basis: Array,
    known: dict[str, Found] | None = None,
) -> Cause:
    """How readings of all channels change by ρ' = ρ (1 + basis · x), with the curves free: their precision of x.

    basis: (m, k). Readings that are NaN are left out. known: channel → parameters of the fit; filled where missing.
    """
    precision, gradient = np.zeros((basis.shape[1],) * 2), np.zeros(basis.shape[1])
    residuals = []
    for name, reading in readings.items():
        use = np.isfinite(reading) & (reading > 0.0)
        equations = ReadingEquations.scaled(wavelengths, matrix[use], reading[use])
        found = None if known is None else known.get(name)
        found = most_evidence(equations, priors[name][0]) if found is None else found
        if found is None:
            raise InputError(DIVERGED)
        if known is not None:
            known[name] = found
        mode = found.mode(equations)
        expected = equations.matrix @ mode.curve
        causes = expected[:, None] * basis[use]
        weighted = equations.inverse(found.noise).times(causes)
        across = (equations.matrix * mode.rate).T @ weighted
        precision += causes.T @ weighted - across.T @ np.linalg.solve(mode.curvature, across)
        gradient += weighted.T @ (equations.readings - expected)
        residuals.append((equations.readings - expected) / np.maximum(equations.readings, 0.05))
    return Cause(precision, gradient, np.concatenate(residuals))
