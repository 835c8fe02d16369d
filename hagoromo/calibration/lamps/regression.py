"""Regression of pixels: robust to some that are wrong, with errors that know that neighbours are wrong together."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.calibration.lamps.ball import Array

REWEIGHTINGS = 15
CAUCHY = 2.385  # standard deviations: 95 % efficient for normal errors (Holland and Welsch 1977)
MAD = 1.4826  # standard deviation of a normal error over its median absolute value


class Fitted(NamedTuple):
    """coefficients (p,), their covariance (p, p), and scatter: standard deviation of the residuals, by their median."""

    coefficients: Array
    covariance: Array
    scatter: float


def robust_regression(design: Array, values: Array, tiles: NDArray[np.integer]) -> Fitted:
    """values (n,) = design (n, p) · coefficients, by Cauchy's weights; errors by tiles that are independent.

    tiles: (n,) number of the tile that each value is in; the covariance is the clustered one (Liang and Zeger 1986).
    """
    weight = np.ones(len(values))
    found, scatter = np.zeros(design.shape[1]), 0.0
    for _ in range(REWEIGHTINGS):
        root = np.sqrt(weight)
        found = np.linalg.lstsq(design * root[:, None], values * root, rcond=None)[0]
        off = values - design @ found
        scatter = float(MAD * np.median(np.abs(off)))
        weight = 1.0 / (1.0 + (off / max(CAUCHY * scatter, 1e-12 * np.abs(values).max() + 1e-30)) ** 2)
    off = values - design @ found
    inverse = np.linalg.pinv(design.T @ (design * weight[:, None]))
    push = np.zeros((int(tiles.max()) + 1, design.shape[1]))
    np.add.at(push, tiles, design * (weight * off)[:, None])
    push = push[np.bincount(tiles, minlength=len(push)) > 0]
    few = len(push) / max(len(push) - design.shape[1], 1)
    return Fitted(np.asarray(found, np.float64), few * inverse @ (push.T @ push) @ inverse, scatter)
