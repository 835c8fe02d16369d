"""Regression over pixels: robust against outliers, with a covariance for residuals that are correlated in tiles."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.calibration.lamps.ball import Array
from hagoromo.least_squares.fit_status import FitStatus
from hagoromo.least_squares.loss import CAUCHY_SCALE, robust_scale
from hagoromo.least_squares.reweighted import reweighted

REGRESSION_REWEIGHTINGS = 15
LARGEST_CHANGE = 1e-3  # relative change of the coefficients in the last reweighting of a fit that has converged


class Regression(NamedTuple):
    """coefficients (p,), their covariance (p, p), and scatter: standard deviation of the residuals, by their median.

    status: how the reweighting ended.
    """

    coefficients: Array
    covariance: Array
    scatter: float
    status: FitStatus


def robust_regression(design: Array, values: Array, tiles: NDArray[np.integer]) -> Regression:
    """values (n,) = design (n, p) · coefficients, with Cauchy's weights.

    tiles: (n,) number of the tile of each value; the covariance is clustered by them (Liang and Zeger 1986).
    """
    smallest = 1e-12 * np.abs(values).max() + 1e-30

    def solve(weight: Array) -> tuple[Array, Array]:
        root = np.sqrt(weight)
        coefficients = np.linalg.lstsq(design * root[:, None], values * root, rcond=None)[0]
        return np.asarray(coefficients, np.float64), values - design @ coefficients

    def reweigh(residuals: Array) -> Array:
        return 1.0 / (1.0 + (residuals / max(CAUCHY_SCALE * robust_scale(residuals), smallest)) ** 2)

    start = np.ones(len(values))
    coefficients, weight, status = reweighted(solve, reweigh, start, REGRESSION_REWEIGHTINGS, LARGEST_CHANGE)
    residuals = values - design @ coefficients
    scatter = robust_scale(residuals)
    inverse = np.linalg.pinv(design.T @ (design * weight[:, None]))
    score = np.zeros((int(tiles.max()) + 1, design.shape[1]))
    np.add.at(score, tiles, design * (weight * residuals)[:, None])
    score = score[np.bincount(tiles, minlength=len(score)) > 0]
    few = len(score) / max(len(score) - design.shape[1], 1)
    return Regression(
        np.asarray(coefficients, np.float64), few * inverse @ (score.T @ score) @ inverse, scatter, status
    )
