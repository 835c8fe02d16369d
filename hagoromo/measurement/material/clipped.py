"""Clipped highlights: samples that the sensor cut off, and what is then not identifiable."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.measurement.observations import Pixels, known_shape
from hagoromo.measurement.sight import sight_of
from hagoromo.photograph.capture import Capture
from hagoromo.photograph.photograph import Photograph
from hagoromo.reflectance.material.material_estimate import MaterialEstimate
from hagoromo.reflectance.parameters import GLOSS, OPEN_GLOSS

FEWEST_AT_TOP = 20  # pixels of exactly one largest value
CROWD = 3.0  # ratio to the count in the BAND below: light that is not clipped becomes rarer towards its peak
BAND = 0.02  # relative width of that band
FEWEST_HIDDEN = 5  # clipped samples closer to the peak of a highlight than any valid one


@dataclass(frozen=True)
class Clipped:
    """nearest: smallest φ [rad] of the valid samples of a material. hidden: number of clipped samples of smaller φ."""

    nearest: float
    hidden: int

    @property
    def remark(self) -> str:
        """One line for a report."""
        return (
            f"the highlights are clipped: no valid sample is closer than {self.nearest:.2g} rad to a peak, "
            f"{self.hidden} clipped ones are, so beta, gamma and n are not identifiable: expose shorter"
        )


def without_plateaus(capture: Capture) -> Capture:
    """`capture` with masked plateaus: pixels that crowd at the largest value of a photograph are clipped."""
    return replace(capture, photographs=tuple(_without_plateau(photograph) for photograph in capture.photographs))


def clipped(capture: Capture, region: NDArray[np.bool_]) -> Clipped:
    """The clipped samples of the pixels `region` (h, w)."""
    pixels, nearest, near = Pixels.where(capture, region & known_shape(capture)), math.pi, []
    for photograph in capture.photographs:
        index = pixels.rows, pixels.columns
        geometry = sight_of(photograph, pixels.points, pixels.normals)
        phi, lit = geometry.least_half_angle, geometry.fit_to_use
        nearest = min(nearest, float(np.min(phi, where=lit & photograph.mask[index], initial=math.pi)))
        near.append(phi[lit & _saturated(photograph)[index]])
    return Clipped(nearest, int(np.sum(np.concatenate(near) < nearest)))


def without_clipped_gloss(estimate: MaterialEstimate, cut: Clipped) -> MaterialEstimate:
    """`estimate`; without its gloss if no valid sample lies within the half width γ of a highlight."""
    measured_inside = cut.nearest < estimate.gamma and estimate.identifiable["gamma"]
    if cut.hidden < FEWEST_HIDDEN or measured_inside:
        return estimate
    known = estimate.interval_95["n"][0] == estimate.interval_95["n"][1]
    bounds: dict[str, Any] = {**OPEN_GLOSS, "specular_albedo": (0.0, 1.0)}
    remarks = [
        one for one in estimate.remarks if "no interface reflection" not in one and "not identifiable" not in one
    ]
    return replace(
        estimate,
        standard_error={**estimate.standard_error, **dict.fromkeys((*GLOSS, "specular_albedo"))},
        interval_95={**estimate.interval_95, **bounds, **({"n": estimate.interval_95["n"]} if known else {})},
        identifiable={**estimate.identifiable, **dict.fromkeys((*GLOSS, "interface_colour"), False)},
        remarks=(*remarks, cut.remark),
    )


def _saturated(photograph: Photograph) -> NDArray[np.bool_]:
    """(h, w) masked pixels at least as bright as the brightest valid ones."""
    values = np.where(np.isfinite(photograph.values), photograph.values, -np.inf)
    largest = np.max(values, axis=(0, 1), where=photograph.mask[..., None], initial=-np.inf)
    return ~photograph.mask & (values >= largest).any(axis=2) & np.isfinite(largest).any()


def _together(crowd: NDArray[np.bool_]) -> bool:
    """Whether most of the pixels `crowd` are in patches, as clipped pixels are and outliers are not."""
    from scipy.ndimage import uniform_filter

    neighbours = 9.0 * uniform_filter(crowd.astype(np.float64), 3, mode="constant") - 1.0
    return bool(np.median(neighbours[crowd]) >= 3.5)


def _without_plateau(photograph: Photograph) -> Photograph:
    mask = photograph.mask.copy()
    for values in np.moveaxis(photograph.values, 2, 0):
        known = values[photograph.mask]
        top = known.max(initial=0.0)
        crowd, band = photograph.mask & (values == top), np.sum((known >= (1.0 - BAND) * top) & (known < top))
        if top > 0.0 and crowd.sum() >= max(FEWEST_AT_TOP, CROWD * band) and _together(crowd):
            mask &= values < top
    lost = int(np.sum(photograph.mask & ~mask))
    if not lost:
        return photograph
    warnings.warn(
        f"{photograph.name}: {lost} pixels crowd at its largest value and are taken for clipped", stacklevel=3
    )
    return replace(photograph, mask=mask)
