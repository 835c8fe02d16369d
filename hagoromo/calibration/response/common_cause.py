"""A cause that changes the readings of all channels alike, such as light that falls off over a chart.

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

Array = NDArray[np.float64]


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
