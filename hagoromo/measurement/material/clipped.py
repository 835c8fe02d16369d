"""Clipped highlights: what the sensor cut off, and what may be said of a gloss whose middle nobody saw."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hagoromo.measurement.observations import Pixels, known_shape
from hagoromo.measurement.robust_fit import GAMMA_RANGE, N_RANGE
from hagoromo.measurement.sight import sight
from hagoromo.photograph.capture import Capture
from hagoromo.photograph.photograph import Photograph
from hagoromo.reflectance.material.material_estimate import MaterialEstimate

FEWEST_AT_TOP = 20  # pixels of exactly one largest value
CROWD = 3.0  # times as many as in the BAND below it: light that is not cut off thins out towards its peak
BAND = 0.02
FEWEST_HIDDEN = 5  # clipped values nearer to a highlight's middle than any valid one
GLOSS = ("beta", "gamma", "n")


@dataclass(frozen=True)
class Clipped:
    """nearest: least φ [rad] that a valid value of the material has. hidden: clipped values that lie nearer."""

    nearest: float
    hidden: int

    @property
    def remark(self) -> str:
        """One line for people."""
        return (
            f"the highlights are clipped: no valid value lies nearer than {self.nearest:.2g} rad to the middle of one, "
            f"{self.hidden} clipped ones do, so beta, gamma and n are not told: expose shorter"
        )


def without_plateaus(capture: Capture) -> Capture:
    """`capture` with the pixels masked that crowd at a photograph's largest value: clipped, though no file says so."""
    return replace(capture, photographs=tuple(_without_plateau(photograph) for photograph in capture.photographs))


def clipped(capture: Capture, region: NDArray[np.bool_]) -> Clipped:
    """What was cut off of the highlights of the pixels `region` (h, w)."""
    pixels, nearest, near = Pixels.where(capture, region & known_shape(capture)), math.pi, []
    for photograph in capture.photographs:
        at = pixels.rows, pixels.columns
        seen = sight(photograph, pixels.points, pixels.normals)
        phi, lit = seen.least_half_angle, seen.fit_to_use
        nearest = min(nearest, float(np.min(phi, where=lit & photograph.mask[at], initial=math.pi)))
        near.append(phi[lit & _saturated(photograph)[at]])
    return Clipped(nearest, int(np.sum(np.concatenate(near) < nearest)))


def with_gloss_untold(found: MaterialEstimate, cut: Clipped) -> MaterialEstimate:
    """`found`, or where nothing valid lies within the half width of its highlights, the same without its gloss."""
    seen_inside = cut.nearest < found.gamma and found.identifiable["gamma"]
    if cut.hidden < FEWEST_HIDDEN or seen_inside:
        return found
    known = found.interval_95["n"][0] == found.interval_95["n"][1]
    bounds = {"beta": (0.0, math.inf), "gamma": GAMMA_RANGE, "specular_albedo": (0.0, 1.0)}
    remarks = [one for one in found.remarks if "no interface reflection" not in one and "not told" not in one]
    return replace(
        found,
        standard_error={**found.standard_error, **dict.fromkeys((*GLOSS, "specular_albedo"))},
        interval_95={**found.interval_95, **bounds, "n": found.interval_95["n"] if known else N_RANGE},
        identifiable={**found.identifiable, **dict.fromkeys(GLOSS, False)},
        remarks=(*remarks, cut.remark),
    )


def _saturated(photograph: Photograph) -> NDArray[np.bool_]:
    """(h, w) masked pixels as bright as the brightest valid ones, or brighter."""
    values = np.where(np.isfinite(photograph.values), photograph.values, -np.inf)
    largest = np.max(values, axis=(0, 1), where=photograph.mask[..., None], initial=-np.inf)
    return ~photograph.mask & (values >= largest).any(axis=2) & np.isfinite(largest).any()


def _together(crowd: NDArray[np.bool_]) -> bool:
    """Whether most of the crowd stands in patches, as clipped light does and gross errors do not."""
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
        f"{photograph.name}: {lost} pixels crowd at its largest value, so they are taken for clipped", stacklevel=3
    )
    return replace(photograph, mask=mask)
