"""Speck: the centre of a clipped highlight, by fitting a blurred and clipped ellipse.

Clipping turns every pixel that the lamp's image touches white, so the centroid follows the edges of the pixels, with
an error of one or two tenths of a pixel. The grey pixels around it show where the image ends.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.calibration.lamps.ball import Array
from hagoromo.least_squares.fit_status import scipy_status

MARGIN = 3  # pixels around the speck
NEAREST, LARGEST = 6, 90  # [px] smallest area for an ellipse, and extent above which the centroid is accurate
POOR = 0.06  # of the peak: largest rms residual of a speck that is an ellipse
ELLIPSE_STEPS = 200  # largest number of evaluations of the fit
ASTRAY = 0.6  # [px] largest distance of the centre from the centroid
FLOOR = 0.03  # [px] standard error of the best fit, for lamps that are not quite ellipses


class Centre(NamedTuple):
    """Centre of an ellipse: x, y [px], and their standard error [px]."""

    x: float
    y: float
    standard_error: float


def ellipse_centre(light: Array, speck: NDArray[np.bool_]) -> Centre | None:
    """The centre of the ellipse in `light` (height, width; its peak is 1) that covers `speck`; None if none fits.

    None also if the fit does not converge: the highlight's centroid is then used, with its own error.
    """
    from scipy.optimize import least_squares
    from scipy.special import ndtr

    rows, columns = np.nonzero(speck)
    if len(rows) < NEAREST or max(np.ptp(rows), np.ptp(columns)) > LARGEST:
        return None
    box = tuple(
        slice(max(int(i.min()) - MARGIN, 0), min(int(i.max()) + MARGIN + 1, size))
        for i, size in zip((rows, columns), light.shape, strict=True)
    )
    window = light[box]
    y, x = np.mgrid[box] + 0.5
    middle = np.array([columns.mean(), rows.mean()]) + 0.5

    def model(parameters: Array) -> Array:
        # (cx, cy), root of the ellipse's matrix [1/px], ln of the unclipped light, ln of the blur [px], background
        u, v = x - parameters[0], y - parameters[1]
        p, q = parameters[2] * u + parameters[3] * v, parameters[3] * u + parameters[4] * v
        rho = np.hypot(p, q) + 1e-9
        slope = np.hypot(parameters[2] * p + parameters[3] * q, parameters[3] * p + parameters[4] * q) / rho + 1e-9
        inside = ndtr((1.0 - rho) / slope / np.hypot(np.exp(parameters[6]), 1.0 / np.sqrt(12.0)))
        return np.minimum(parameters[7] + np.exp(parameters[5]) * inside, 1.0)

    spread = np.linalg.inv(np.cov(np.stack([columns, rows])) + np.eye(2) / 12.0)
    values, axes = np.linalg.eigh(spread)
    root = axes @ np.diag(0.5 * np.sqrt(values)) @ axes.T  # a disc's second moment is a quarter of its radius squared
    start = np.r_[middle, root[0, 0], root[0, 1], root[1, 1], np.log(3.0), np.log(0.5), np.median(window)]
    fit = least_squares(
        lambda parameters: (model(parameters) - window).ravel(),
        start,
        loss="soft_l1",
        f_scale=0.03,
        max_nfev=ELLIPSE_STEPS,
    )
    if not scipy_status(fit).converged:
        return None
    rms = float(np.sqrt(np.mean((model(fit.x) - window) ** 2)))
    if not rms < POOR or not np.hypot(*(fit.x[:2] - middle)) < ASTRAY:
        return None
    covariance = np.linalg.pinv(fit.jac.T @ fit.jac)[:2, :2] * rms**2
    return Centre(float(fit.x[0]), float(fit.x[1]), float(np.hypot(np.sqrt(np.trace(covariance) / 2.0), FLOOR)))
