"""Falloff of the light over a photographed chart, and the photograph that contradicts the others.

A lamp near a chart lights one side more than the other. Readings divided by the falloff are what the patches' spectra
explain, so both are fitted together: ln falloff is a polynomial of second degree over the chart, with mean 0, one for
each photograph and common to its channels.

Readings that are not linear in light look like falloff: so a power of all channels and an offset of each are fitted
beside it, and falloff is certain only where these do not explain it.

A cause that changes the readings of all channels alike, such as light that falls off over a chart.

Enters: readings of all channels, and what they change by. Leaves: how large the cause is, with the curves free.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.calibration.response.curve_evidence import DIVERGED, Found, most_evidence
from hagoromo.calibration.response.curve_prior import CurvePrior
from hagoromo.calibration.response.reading_equations import ReadingEquations
from hagoromo.calibration.response.reading_transfer import TRANSFER_PRIOR
from hagoromo.errors import InputError

FALLOFF_PRIOR = 0.2  # standard deviation of each coefficient of ln falloff, over half of the chart
FALLOFF_FITS = 4  # of the curves and the falloff in turn
DARKEST = 1e-3  # of the mean reading: darker ones are taken as this
CERTAIN_FALLOFF = 30.0  # fall of χ² per photograph, of five coefficients: p < 2e-5
LEAST_FALLOFF = 0.005  # share of the light; less is neither reported nor corrected
STRENGTH_STEPS = 2  # of the strengths of lamps and the curves in turn
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
    """(photographs, 5): ln falloff over each chart, see `light_over_chart`; 0 where it is not certainly uneven."""
    basis, bent = _basis(chart), _Transfer.none(chart)
    coefficients, precision, known = np.zeros(basis.shape[1]), np.zeros((basis.shape[1],) * 2), {}
    for k in range(FALLOFF_FITS):
        known = known if k != FALLOFF_FITS - 1 else {}  # the last with the noise that is left
        even = bent.linearised(chart.divided(np.exp(basis @ coefficients)))
        causes = {name: np.hstack([basis, more]) for name, more in bent.causes(even).items()}
        cause = common_cause(even.wavelengths, even.matrix, even.readings, priors, causes, known)
        spread = np.append(np.full(len(coefficients), FALLOFF_PRIOR), bent.spread())
        now = np.append(coefficients, bent.coefficients())
        whole = cause.precision + np.diag(spread**-2.0)
        now = now + np.linalg.solve(whole, cause.gradient - now / spread**2)
        coefficients, bent = now[: len(coefficients)], bent.at(now[len(coefficients) :])
        own, other = np.s_[: len(coefficients)], np.s_[len(coefficients) :]
        explained = whole[own, other] @ np.linalg.solve(whole[other, other], whole[other, own])
        precision = cause.precision[own, own] - explained
    return _certain(basis, coefficients, precision, int(chart.photograph.max()) + 1)


class _Transfer(NamedTuple):
    """Readings over light: ρ^power, and an offset per channel over its mean reading, where they are not linear.

    level: channel → mean reading.
    """

    level: dict[str, float]
    log_power: float
    offsets: Array

    @staticmethod
    def none(chart: ChartReadings) -> _Transfer:
        """Linear readings."""
        level = {name: float(np.nanmean(reading)) for name, reading in chart.readings.items()}
        return _Transfer(level, 0.0, np.zeros(len(level)))

    def linearised(self, chart: ChartReadings) -> ChartReadings:
        """Readings that are proportional to light."""
        power = np.exp(-self.log_power)
        return chart._replace(
            readings={
                name: self.level[name] * np.maximum(reading / self.level[name] - offset, DARKEST) ** power
                for (name, reading), offset in zip(chart.readings.items(), self.offsets, strict=True)
            }
        )

    def causes(self, even: ChartReadings) -> dict[str, Array]:
        """Channel → (m, 1 + channels): relative change of linearised readings by ln power, and by each offset."""
        found = {}
        for k, (name, reading) in enumerate(even.readings.items()):
            share = np.nan_to_num(np.maximum(reading / self.level[name], DARKEST), nan=1.0)
            found[name] = np.zeros((len(share), 1 + len(even.readings)))
            found[name][:, 0], found[name][:, 1 + k] = np.log(share), 1.0 / share
        return found

    def spread(self) -> Array:
        """Standard deviations before the readings: see `TRANSFER_PRIOR`."""
        return np.append(TRANSFER_PRIOR[0], np.full(len(self.offsets), TRANSFER_PRIOR[1]))

    def coefficients(self) -> Array:
        """ln power and the offsets."""
        return np.append(self.log_power, self.offsets)

    def at(self, coefficients: Array) -> _Transfer:
        """With other coefficients, within what readings can be."""
        offsets = np.clip(coefficients[1:], -0.5, 0.5)
        return self._replace(log_power=float(np.clip(coefficients[0], -1.6, 1.6)), offsets=offsets)


def _certain(basis: Array, coefficients: Array, precision: Array, count: int) -> Array:
    """(photographs, 5): the coefficients of the photographs whose falloff is certain and matters, else 0."""
    kept = np.zeros_like(coefficients)
    for k in range(count):
        own = slice(5 * k, 5 * (k + 1))
        part = np.zeros_like(coefficients)
        part[own] = coefficients[own]
        if part @ precision @ part > CERTAIN_FALLOFF and np.ptp(np.exp(basis @ part)) > LEAST_FALLOFF:
            kept += part
    return kept.reshape(count, 5)


def light_over_chart(coefficients: Array, x: Array | float, y: Array | float) -> Array:
    """Light relative to its mean over the chart, exp(c · (x, y, x², x y, y²) less their means), at places of the chart.

    coefficients: (5,). x, y: −1 … 1 from the first to the last column and row of patches.
    """
    columns, rows = np.meshgrid(np.linspace(-1.0, 1.0, 6), np.linspace(-1.0, 1.0, 4))
    return np.exp((_terms(np.asarray(x), np.asarray(y)) - _terms(columns, rows).mean(axis=(0, 1))) @ coefficients)


def share_of_light(chart: ChartReadings, coefficients: Array) -> Array:
    """(m,): light at each reading relative to the mean of its photograph."""
    return np.exp(_basis(chart) @ coefficients.ravel())


def _terms(x: Array, y: Array) -> Array:
    return np.stack([x, y, x**2, x * y, y**2], axis=-1)


def _basis(chart: ChartReadings) -> Array:
    """(m, 5 · photographs): x, y, x², x y, y² over the chart of 6 × 4 patches, each of mean 0."""
    row, column = np.divmod(np.arange(24), 6)
    terms = _terms((column - 2.5) / 2.5, (row - 1.5) / 1.5)
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


class Exchanged(NamedTuple):
    """Two photographs (from 0) whose lamps fit when exchanged; misfit: relative, as the lamps were given, and so."""

    pair: tuple[int, int]
    misfit: tuple[float, float]

    def finding(self, names: Sequence[str]) -> str:
        """One sentence."""
        a, b = (names[k] for k in self.pair)
        given, so = (f"{100 * of:.2g} %" for of in self.misfit)
        return (
            f"the lamps of {a} and {b} are exchanged: exchanged, the readings fit to {so}, as given to {given}: give "
            "the lamps in the order of the photographs"
        )


def exchanged_lamps(chart: ChartReadings, priors: Mapping[str, Sequence[CurvePrior]]) -> Exchanged | None:
    """The pair of photographs with whose lamps exchanged the readings fit much better; None where there is none."""
    count = int(chart.photograph.max()) + 1
    misfit = _misfit(chart, priors, free_strengths=True) if count > 1 else 0.0
    if misfit < DOUBTFUL_MISFIT:
        return None
    blocks = [chart.matrix[chart.photograph == k] for k in range(count)]
    found: list[tuple[float, tuple[int, int]]] = []
    for a, b in combinations(range(count), 2):
        matrix = chart.matrix.copy()
        matrix[chart.photograph == a], matrix[chart.photograph == b] = blocks[b], blocks[a]
        found.append((_misfit(chart._replace(matrix=matrix), priors, free_strengths=True), (a, b)))
    best, pair = min(found)
    return Exchanged(pair, (misfit, best)) if best < MISFIT_RATIO * misfit else None


def _misfit(chart: ChartReadings, priors: Mapping[str, Sequence[CurvePrior]], free_strengths: bool = False) -> float:
    """Root mean square of the relative residuals over all channels. free_strengths: of the lamps."""
    others = np.arange(1, int(chart.photograph.max()) + 1) if free_strengths else np.zeros(0, np.intp)
    strengths = (chart.photograph[:, None] == others).astype(np.float64)
    basis, gains = {name: strengths for name in chart.readings}, np.zeros(len(others))
    cause = common_cause(chart.wavelengths, chart.matrix, chart.readings, priors, basis)
    for _ in range(STRENGTH_STEPS if len(others) else 0):
        gains = gains + np.linalg.solve(cause.precision + 1e-9 * np.eye(len(gains)), cause.gradient)
        even = chart.divided(np.exp(strengths @ gains))
        cause = common_cause(chart.wavelengths, chart.matrix, even.readings, priors, basis)
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
    basis: Mapping[str, Array],
    known: dict[str, Found] | None = None,
) -> Cause:
    """How readings of all channels change by ρ' = ρ (1 + basis · x), with the curves free: their precision of x.

    basis: channel → (m, k). Readings that are NaN are left out. known: channel → parameters of the fit; filled where
    missing.
    """
    count = next(iter(basis.values())).shape[1]
    precision, gradient = np.zeros((count, count)), np.zeros(count)
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
        causes = expected[:, None] * basis[name][use]
        weighted = equations.inverse(found.noise).times(causes)
        across = (equations.matrix * mode.rate).T @ weighted
        precision += causes.T @ weighted - across.T @ np.linalg.solve(mode.curvature, across)
        gradient += weighted.T @ (equations.readings - expected)
        residuals.append((equations.readings - expected) / np.maximum(equations.readings, 0.05))
    return Cause(precision, gradient, np.concatenate(residuals))
