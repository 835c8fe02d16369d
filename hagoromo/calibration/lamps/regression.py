"""Regression of pixels: robust to some that are wrong, with errors that know that neighbours are wrong together."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.calibration.lamps.ball import Array
from hagoromo.least_squares import CAUCHY_SCALE, FitStatus, reweighted, robust_scale

REGRESSION_REWEIGHTINGS = 15
STANDSTILL = 1e-3  # relative change of the coefficients in the last of them, beyond which they have not converged


class Fitted(NamedTuple):
    """coefficients (p,), their covariance (p, p), and scatter: standard deviation of the residuals, by their median.

    status: how the reweighting ended.
    """

    coefficients: Array
    covariance: Array
    scatter: float
    status: FitStatus


def robust_regression(design: Array, values: Array, tiles: NDArray[np.integer]) -> Fitted:
    """values (n,) = design (n, p) · coefficients, by Cauchy's weights; errors by tiles that are independent.

    tiles: (n,) number of the tile that each value is in; the covariance is the clustered one (Liang and Zeger 1986).
    """
    smallest = 1e-12 * np.abs(values).max() + 1e-30

    def solve(weight: Array) -> tuple[Array, Array]:
        root = np.sqrt(weight)
        found = np.linalg.lstsq(design * root[:, None], values * root, rcond=None)[0]
        return np.asarray(found, np.float64), values - design @ found

    def reweigh(off: Array) -> Array:
        return 1.0 / (1.0 + (off / max(CAUCHY_SCALE * robust_scale(off), smallest)) ** 2)

    start = np.ones(len(values))
    found, weight, status = reweighted(solve, reweigh, start, REGRESSION_REWEIGHTINGS, STANDSTILL)
    off = values - design @ found
    scatter = robust_scale(off)
    inverse = np.linalg.pinv(design.T @ (design * weight[:, None]))
    push = np.zeros((int(tiles.max()) + 1, design.shape[1]))
    np.add.at(push, tiles, design * (weight * off)[:, None])
    push = push[np.bincount(tiles, minlength=len(push)) > 0]
    few = len(push) / max(len(push) - design.shape[1], 1)
    return Fitted(np.asarray(found, np.float64), few * inverse @ (push.T @ push) @ inverse, scatter, status)
