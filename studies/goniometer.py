"""Goniometer: readings of a flat sample, lamp and eye turned about it, as `Observations` that a material is fitted to.

Local axes: the sample's normal is +z. A reading is radiance per irradiance facing the lamp: f of eq. (2), C channels.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import hagoromo as hg

Array = NDArray[np.float64]
INCIDENCE = (0, 15, 30, 45, 60, 70)  # [°] from the normal
EYE_OFFSETS_DEG = (0, 0.5, 1, 2, 3, 5, 8, 12, 18, 25, 35, 50, 70, 90)  # [°] of the eye from the mirror direction
EYE_AZIMUTHS_DEG = (
    0,
    90,
    180,
)  # [°] in which the eye leaves the mirror direction: to grazing, to the side, back over the lamp
HIGHEST = 75.0  # [°] from the normal up to which the eye goes


class Directions(NamedTuple):
    """N pairs of unit vectors in the sample's axes: to_lamp (N, 3), to_eye (N, 3)."""

    to_lamp: Array
    to_eye: Array


def goniometer() -> Directions:
    """The directions of a measurement: fine about the mirror direction, in the plane of incidence and across it."""
    pairs = [
        _pair(*np.radians((lamp, offset, way)))
        for lamp in INCIDENCE
        for offset in EYE_OFFSETS_DEG
        for way in EYE_AZIMUTHS_DEG
    ]
    pairs_array = np.array(pairs)
    within = pairs_array[:, 1, 2] >= np.cos(np.radians(HIGHEST))
    _, first = np.unique(np.round(pairs_array[within], 9), axis=0, return_index=True)  # an offset of 0 has no way
    return Directions(*np.moveaxis(pairs_array[within][np.sort(first)], 1, 0))


def readings(directions: Directions, values: Array, variance: Array) -> hg.Observations:
    """Readings `values` (N, C) of known `variance` (N, C), as observations.

    `InputError` when the shapes differ, a value is not finite or has no variance.
    """
    values, variance = np.asarray(values, np.float64), np.asarray(variance, np.float64)
    if values.ndim != 2 or values.shape != variance.shape or len(values) != len(directions.to_lamp):
        shapes = f"{values.shape} and variance of shape {variance.shape}"
        raise hg.InputError(f"{len(directions.to_lamp)} directions, values of shape {shapes}: give (N, C) for both")
    if not (np.isfinite(values).all() and np.isfinite(variance).all() and (variance > 0.0).all()):
        raise hg.InputError("readings need finite values and a variance above 0")
    sight = hg.Sight(cosines_of(directions), np.ones((len(values), 1, values.shape[1])))
    used = np.broadcast_to(sight.fit_to_use[:, None], values.shape)
    places: NDArray[np.int64] = np.arange(len(values))
    return hg.Observations(
        values, variance, np.zeros_like(values), used, sight, np.full(values.shape, np.inf), places, places
    )


def cosines_of(directions: Directions) -> hg.Cosines:
    """The four cosines (N, 1) of each pair."""
    deviation = np.sqrt(np.maximum(0.5 + 0.5 * np.einsum("ni,ni->n", *directions), 1e-12))
    incidence, view = directions.to_lamp[:, 2], directions.to_eye[:, 2]
    half = np.clip(0.5 * (incidence + view) / deviation, -1.0, 1.0)
    return hg.Cosines(*(cosine[:, None] for cosine in (incidence, view, half, deviation)))


def _pair(lamp: float, offset: float, way: float) -> tuple[tuple[float, float, float], Array]:
    """Lamp at the angle `lamp` from the normal towards −x; eye `offset` from its mirror direction."""
    mirror = np.array([np.sin(lamp), 0.0, np.cos(lamp)])
    down, aside = np.array([np.cos(lamp), 0.0, -np.sin(lamp)]), np.array([0.0, 1.0, 0.0])
    eye = np.cos(offset) * mirror + np.sin(offset) * (np.cos(way) * down + np.sin(way) * aside)
    return (-np.sin(lamp), 0.0, np.cos(lamp)), eye
