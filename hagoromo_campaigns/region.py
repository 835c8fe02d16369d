"""ChangedRegion: connected places where a quantity differs significantly, with its mean and what that may be.

The standard error of the mean of N pixels is that of independent ones, √(Σ variance)/N, times the widening of errors
that `significant` found at the width whose Gaussian covers N pixels.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.least_squares.loss import NORMAL_95
from hagoromo_campaigns.campaign import Campaign
from hagoromo_campaigns.quantity import Quantity, scale_of
from hagoromo_campaigns.significance import WIDTHS, parts

Array = NDArray[np.float64]
MOST_REGIONS = 500  # of a quantity, the largest; the map has all


@dataclass(frozen=True)
class ChangedRegion:
    """One region: its number within its quantity, the quantity, the lamp of its colours ("" for other quantities).

    area: in area_unit. x_px, y_px: its middle in BEFORE's image [px]. mean, low, high: of its pixels in `unit`, and the
    95 % interval: of colour ΔE00 of its mean colours, of normals the root mean square of the angle less that of their
    errors. most: the value farthest from 0.
    """

    number: int
    quantity: str
    lamp: str
    unit: str
    pixels: int
    area: float
    area_unit: str
    x_px: float
    y_px: float
    mean: float
    low: float
    high: float
    most: float

    def record(self) -> dict[str, Any]:
        """As JSON files and tables have it."""
        return asdict(self)


def regions(quantity: Quantity, before: Campaign) -> tuple[ChangedRegion, ...]:
    """The regions of a quantity, by falling area; of colour one for each lamp."""
    numbers, count = parts(quantity.significance.found)
    area, unit = pixel_areas(before)
    sizes = np.bincount(numbers.ravel(), np.where(quantity.significance.found, area, 0.0).ravel(), count + 1)[1:]
    order = np.argsort(-sizes)[:MOST_REGIONS]
    found = []
    for number, index in enumerate(order, 1):
        inside = numbers == index + 1
        rows, columns = np.nonzero(inside)
        for lamp, value in quantity.value.items():
            mean, low, high = _mean(quantity, lamp, inside, before.pitch)
            most = float(value[inside][np.argmax(np.abs(value[inside]))])
            place = float(columns.mean() + 0.5), float(rows.mean() + 0.5)
            where = len(rows), float(sizes[index]), unit, *place
            found.append(ChangedRegion(number, quantity.name, lamp, quantity.unit, *where, mean, low, high, most))
    return tuple(found)


def pixel_areas(before: Campaign) -> tuple[Array, str]:
    """(h, w) area of the surface that each pixel shows, 0 where unknown, and its unit: mm², or px² without a scale."""
    ray = before.camera.position - before.points
    away = np.linalg.norm(ray, axis=2)
    with np.errstate(invalid="ignore", divide="ignore"):
        cosine = np.maximum(np.einsum("hwi,hwi->hw", ray, before.normals) / away, 0.1)
        area = (away**2 / (before.camera.focal[0] * before.camera.focal[1])) / cosine
    unit = 1e-6 if before.in_metres else before.pitch**2
    return np.where(before.known, np.nan_to_num(area) / unit, 0.0), "mm²" if before.in_metres else "px²"


def _mean(quantity: Quantity, lamp: str, inside: NDArray[np.bool_], pitch: float) -> tuple[float, float, float]:
    """Mean and 95 % interval, in the unit of the quantity."""
    difference, variance = quantity.difference[inside], quantity.variance[inside]
    count, scale = len(difference), scale_of(quantity, pitch)
    covered = [max(4.0 * np.pi * width**2, 1.0) for width in WIDTHS]
    wider = quantity.significance.widening[max(k for k, area in enumerate(covered) if area <= count)]
    mean, of_mean = difference.mean(axis=0), wider**2 * variance.sum(axis=0) / count**2
    if quantity.paint is not None:
        before = np.exp(np.log(quantity.paint.before[inside]).mean(axis=0))
        value = float(quantity.paint.delta_e(lamp, before, mean))
        error = float(quantity.paint.delta_e_error(lamp, before, mean, of_mean))
        return value, max(value - NORMAL_95 * error, 0.0), value + NORMAL_95 * error
    if quantity.name == "normals":
        square = max(float((difference**2).sum(axis=1).mean() - variance.sum(axis=1).mean()), 0.0)
        spread = wider * float(np.sqrt((4.0 * difference**2 * variance + 2.0 * variance**2).sum())) / count
        low, high = (np.sqrt(max(square + side * NORMAL_95 * spread, 0.0)) for side in (-1.0, 1.0))
        return scale * float(np.sqrt(square)), scale * float(low), scale * float(high)
    ends = float(mean[0]) + NORMAL_95 * float(np.sqrt(of_mean[0])) * np.array([0.0, -1.0, 1.0])
    value, low, high = scale * (np.expm1(ends) if quantity.unit == "%" else ends)
    return float(value), float(low), float(high)
