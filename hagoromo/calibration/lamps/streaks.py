"""Streaks: the place where streaks of glare meet, which is the lamp's image.

The edges of a streak run towards the lamp, or past it at half of the streak's width, one on either side. So the centre
c is where Σ w ((p − c) · g)² is least, over pixels p with the slope g of their light (Förstner 1987). Ends of streaks,
whose slope points along them, are outliers of Cauchy's loss.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.calibration.lamps.ball import Array

SMOOTHED = 0.8  # [px] standard deviation, under which slopes are taken
ASIDE = (4.0, 5.0, 6.5)  # [px] scale of the loss: some times what an edge passes the lamp by; the middle one is used
AROUND = 3  # [px] around the speck whose slopes count
STARTS, STEPS, SETTLED = 25, 40, 1e-3  # first guesses within the speck; of the iteration; [px]
FAINT = 0.01  # of the steepest slope: fainter ones are noise
ALIKE = 0.03  # least ratio of the two curvatures: streaks along one line meet anywhere
AS_GOOD = 1.1  # times the least cost: centres of less are as likely
RIM = 0.5  # of the lamp's radius: standard error, as edges of the lamp itself pass its centre by the radius


class Meeting(NamedTuple):
    """place (x, y) where streaks meet, and its standard error [px]."""

    place: Array
    error: float


def where_streaks_meet(light: Array, speck: NDArray[np.bool_], radius: float = 0.0) -> Meeting | None:
    """Where the streaks of the speck meet; None where they do not cross.

    radius: of the lamp's image [px]. The error holds the range over scales, and over centres of about the same cost.
    """
    from scipy.ndimage import binary_dilation, gaussian_filter1d

    near = np.asarray(binary_dilation(speck, iterations=AROUND), np.bool_) & (light > 0.0)
    smooth = [gaussian_filter1d(light, SMOOTHED, axis=axis) for axis in (0, 1)]
    slopes = [
        gaussian_filter1d(one, SMOOTHED, axis=axis, order=1)[near] for axis, one in zip((1, 0), smooth, strict=True)
    ]
    slope = np.stack(slopes, axis=1).astype(np.float64)
    steep = np.linalg.norm(slope, axis=1)
    kept = steep > FAINT * steep.max()
    points, slope = (np.argwhere(near)[:, ::-1] + 0.5)[kept].astype(np.float64), slope[kept]
    inside = (np.argwhere(speck)[:, ::-1] + 0.5).astype(np.float64)
    starts = inside[np.unique(np.linspace(0, len(inside) - 1, STARTS).astype(int))]
    centres, scatter = [], []
    for scale in ASIDE:
        found = [_settled(points, slope, start, scale) for start in starts]
        centre, least, ratio = min(found, key=lambda one: one[1])
        if ratio < ALIKE:
            return None
        centres.append(centre)
        as_good = np.array([one[0] for one in found if one[1] < AS_GOOD * least])
        scatter.append(np.sqrt(np.mean(np.sum((as_good - centre) ** 2, axis=1))))
    parts = float(np.ptp(centres, axis=0).max()), float(max(scatter)), RIM * radius
    return Meeting(centres[len(centres) // 2], float(np.hypot.reduce(parts)))


def _settled(points: Array, slope: Array, start: Array, scale: float) -> tuple[Array, float, float]:
    """The centre from `start` on, its cost, and the ratio of its curvatures."""
    centre, squared = start, np.sum(slope**2, axis=1)
    normal, ratio = np.eye(2), 1.0
    for _ in range(STEPS):
        off = np.sum((points - centre) * slope, axis=1) ** 2 / squared / scale**2
        weighed = slope / (1.0 + off)[:, None]
        normal = weighed.T @ slope
        low, high = np.linalg.eigvalsh(normal)
        ratio = float(low / high)
        if ratio < 1e-9:
            break
        after = np.linalg.solve(normal, weighed.T @ np.sum(slope * points, axis=1))
        step, centre = np.hypot(*(after - centre)), after
        if step < SETTLED:
            break
    off = np.sum((points - centre) * slope, axis=1) ** 2 / squared / scale**2
    return centre, float(squared @ np.log1p(off)), ratio
