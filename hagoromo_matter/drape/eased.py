"""Eased: a sheet without the folds that are too narrow for a lattice; there the cloth stays gathered."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hagoromo_matter.drape.sheet import Sheet

SMOOTHED_RATIO = 0.85, 0.55  # smoothed length over length of the cloth: smoothing begins, and is complete


def eased(sheet: Sheet, width_mm: float) -> Sheet:
    """The sheet with folds narrower than about `width_mm` of cloth smoothed out, where it has such.

    Where the smoothed cloth is nearly as long as it was cut, it is left unchanged.
    """
    wide = sheet.around > 0
    rest = _rest(sheet)
    sigma = tuple(width_mm / length for length in rest)
    smooth = _smoothed(sheet.points, sigma, wide)
    share = np.ones(sheet.u.shape)
    for axis, length in enumerate(rest):
        steps = _slopes(smooth, axis, wide)
        easing = np.clip(
            (SMOOTHED_RATIO[0] - np.linalg.norm(steps, axis=2) / length) / (SMOOTHED_RATIO[0] - SMOOTHED_RATIO[1]),
            0.0,
            1.0,
        )
        share *= 1.0 - easing
    part = _smoothed(1.0 - share, tuple(0.5 * s for s in sigma), wide)[..., None]
    return Sheet(sheet.points + part * (smooth - sheet.points), sheet.u, sheet.v, sheet.around)


def _rest(sheet: Sheet) -> tuple[float, float]:
    """Mean length of cloth between rows and between columns [mm]."""
    return float(np.abs(np.diff(sheet.v, axis=0)).mean()), float(np.abs(np.diff(sheet.u, axis=1)).mean())


def _smoothed(values: NDArray, sigma: tuple[float, ...], wide: bool) -> NDArray[np.float64]:
    """Gaussian means over rows and columns, `sigma` of each [steps]; open ends stay where they are."""
    from scipy.ndimage import gaussian_filter1d

    for axis, steps in enumerate(sigma):
        if wide and axis == 1:
            values = gaussian_filter1d(values, steps, axis=1, mode="wrap")
        else:  # mirrored through its ends, which so keep their places
            reach = min(int(4.0 * steps) + 1, values.shape[axis] - 1)
            padding = [(reach, reach) if k == axis else (0, 0) for k in range(values.ndim)]
            wider = np.pad(values, padding, mode="reflect", reflect_type="odd")
            inner = [slice(reach, -reach) if k == axis else slice(None) for k in range(values.ndim)]
            values = gaussian_filter1d(wider, steps, axis=axis, mode="nearest")[tuple(inner)]
    return values


def _slopes(points: NDArray, axis: int, wide: bool) -> NDArray[np.float64]:
    """Change from point to point along rows or columns."""
    if not (wide and axis == 1):
        return np.gradient(points, axis=axis)
    closed = np.concatenate([points[:, -1:], points, points[:, :1]], axis=1)
    return np.gradient(closed, axis=1)[:, 1:-1]
