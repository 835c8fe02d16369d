"""Speck: the centre of a highlight that is clipped, by the ellipse whose blurred and clipped image it is.

Clipping turns every pixel that the lamp's image touches white, so the centroid follows the pixels' edges, off by a
tenth of a pixel or two. The grey pixels around tell where the image ends.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.calibration.lamps.ball import Array
from hagoromo.least_squares import scipy_status

MARGIN = 3  # pixels around the speck
NEAREST, LARGEST = 6, 90  # px: fewer pixels tell no ellipse; wider specks have a good centroid
POOR = 0.06  # of the peak, rms: a worse fit is that of another shape than an ellipse
ELLIPSE_STEPS = 200  # evaluations of the fit
ASTRAY = 0.6  # px from the centroid beyond which the fit is not that of the speck
FLOOR = 0.03  # px: standard error of the best fit, of lamps that are no ellipses


class Centre(NamedTuple):
    """Of an ellipse: x, y [px], and their standard error [px]."""

    x: float
    y: float
    standard_error: float


def ellipse_centre(light: Array, speck: NDArray[np.bool_]) -> Centre | None:
    """The centre of the ellipse in `light` (height, width; its peak is 1) that shows as `speck`; None if none fits.

    A fit that does not converge is none: the highlight's centroid is then stated, with its own error.
    """
    from scipy.optimize import least_squares
    from scipy.special import ndtr

    rows, columns = np.nonzero(speck)
    if len(rows) < NEAREST or max(np.ptp(rows), np.ptp(columns)) > LARGEST:
        return None
    box = tuple(slice(max(int(i.min()) - MARGIN, 0), int(i.max()) + MARGIN + 1) for i in (rows, columns))
    seen = light[box]
    y, x = np.mgrid[box] + 0.5
    middle = np.array([columns.mean(), rows.mean()]) + 0.5

    def model(found: Array) -> Array:
        # (cx, cy), the ellipse's matrix as its root [1/px], ln of the light unclipped, ln of the blur [px], ground
        u, v = x - found[0], y - found[1]
        p, q = found[2] * u + found[3] * v, found[3] * u + found[4] * v
        rho = np.hypot(p, q) + 1e-9
        slope = np.hypot(found[2] * p + found[3] * q, found[3] * p + found[4] * q) / rho + 1e-9
        inside = ndtr((1.0 - rho) / slope / np.hypot(np.exp(found[6]), 1.0 / np.sqrt(12.0)))
        return np.minimum(found[7] + np.exp(found[5]) * inside, 1.0)

    spread = np.linalg.inv(np.cov(np.stack([columns, rows])) + np.eye(2) / 12.0)
    values, axes = np.linalg.eigh(spread)
    root = axes @ np.diag(0.5 * np.sqrt(values)) @ axes.T  # a disc's second moment is a quarter of its radius squared
    start = np.r_[middle, root[0, 0], root[0, 1], root[1, 1], np.log(3.0), np.log(0.5), np.median(seen)]
    fit = least_squares(
        lambda found: (model(found) - seen).ravel(), start, loss="soft_l1", f_scale=0.03, max_nfev=ELLIPSE_STEPS
    )
    if not scipy_status(fit).converged:
        return None
    rms = float(np.sqrt(np.mean((model(fit.x) - seen) ** 2)))
    if not rms < POOR or not np.hypot(*(fit.x[:2] - middle)) < ASTRAY:
        return None
    covariance = np.linalg.pinv(fit.jac.T @ fit.jac)[:2, :2] * rms**2
    return Centre(float(fit.x[0]), float(fit.x[1]), float(np.hypot(np.sqrt(np.trace(covariance) / 2.0), FLOOR)))
