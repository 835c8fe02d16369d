"""Overlap: AFTER's maps as BEFORE's pixels see them, and the errors that this adds.

Enters: two campaigns and their registration. Leaves: AFTER's maps at the pixels of BEFORE, NaN where AFTER does not
show them, and the variance by the error of the registration and by interpolation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion, grey_dilation, grey_erosion

from hagoromo.measurement.nearest import nearest_known
from hagoromo_campaigns.campaign import Campaign
from hagoromo_campaigns.registration import AWAY, Registration
from hagoromo_campaigns.sampled import sampled

Array = NDArray[np.float64]
BEHIND = 4.0  # pitch behind another part of BEFORE, from which AFTER does not show a place
RIM_PX = 2  # at the edge of what each campaign knows: its pixels are mixtures, and splines do not reach over it
UNSURE = 0.5  # of the difference of a cubic and a linear interpolation: the error of the first, one standard deviation


@dataclass(frozen=True, eq=False)
class Overlap:
    """image: (h, w, 2) where AFTER shows BEFORE's pixels [px]; errors: (h, w, 2, 2) its covariance. shown: (h, w)."""

    before: Campaign
    after: Campaign
    registration: Registration
    image: Array
    shown: NDArray[np.bool_]
    errors: Array

    def after_map(self, maps: Array, along: Array | None = None) -> tuple[Array, Array]:
        """AFTER's `maps` (h', w', k) at BEFORE's pixels (h, w, k), and their variance by registration and
        interpolation.

        along: (h, w, m, k) directions, in AFTER's world, along which vectors are compared: the variance is of those m.
        """
        filled = _filled(maps)
        linear, cubic = sampled(maps, self.image), sampled(filled, self.image, order=3)
        value = np.where(np.isfinite(linear) & self.shown[..., None], cubic, np.nan)
        slopes = [sampled(np.gradient(filled, axis=axis), self.image) for axis in (1, 0)]
        parts = [*slopes, UNSURE * (cubic - linear)]
        if along is not None:
            parts = [np.einsum("hwmk,hwk->hwm", along, part) for part in parts]
        slope = np.stack(parts[:2], axis=-1)
        moved = np.einsum("hwki,hwij,hwkj->hwk", slope, self.errors, slope)
        return value, moved + parts[2] ** 2

    def after_variance(self, maps: Array) -> Array:
        """AFTER's variances (h', w', k) at BEFORE's pixels."""
        return np.where(self.shown[..., None], sampled(maps, self.image), np.nan)


def overlap(before: Campaign, after: Campaign, registration: Registration) -> Overlap:
    """What both campaigns show."""
    there = registration.to_after.points(before.points)
    image = after.camera.project(there)
    to_eye = after.camera.position - there
    facing = np.einsum("hwi,hwi->hw", registration.to_after.directions(before.normals), to_eye)
    with np.errstate(invalid="ignore"):
        shown = _without_rim(before.known) & (facing > AWAY * np.linalg.norm(to_eye, axis=2))
    shown &= np.isfinite(sampled(np.where(_without_rim(after.known), 1.0, np.nan), image))
    shown &= ~_hidden(
        np.linalg.norm(to_eye, axis=2), image, shown, after, BEHIND * before.pitch * registration.to_after.scale
    )
    return Overlap(before, after, registration, image, shown, np.nan_to_num(registration.image_errors(before, after)))


def _without_rim(known: NDArray[np.bool_]) -> NDArray[np.bool_]:
    return np.asarray(binary_erosion(known, np.ones((3, 3)), RIM_PX), bool)


def _hidden(away: Array, image: Array, shown: NDArray[np.bool_], after: Campaign, behind: float) -> NDArray[np.bool_]:
    """Which pixels lie behind others of BEFORE, by the nearest of them at each pixel of AFTER and beside it."""
    height, width = after.known.shape
    x, y = (np.floor(np.nan_to_num(image[..., k], nan=-1.0)).astype(int) for k in range(2))
    inside = shown & (x >= 0) & (x < width) & (y >= 0) & (y < height)
    nearest = np.full((height, width), np.inf)
    np.minimum.at(nearest, (y[inside], x[inside]), away[inside])
    nearest = grey_erosion(nearest, size=(3, 3))
    hidden = np.zeros(shown.shape, bool)
    hidden[inside] = away[inside] > nearest[y[inside], x[inside]] + behind
    return np.asarray(grey_dilation(hidden, size=(3, 3)), bool)


def _filled(maps: Array) -> Array:
    """`maps` (h, w, k) with the nearest known value where one is unknown."""
    known = np.asarray(np.isfinite(maps).all(axis=2))
    if known.all():
        return maps
    return maps[nearest_known(known)]
