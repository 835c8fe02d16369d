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
LEAST_COSINE = 1e-6  # lamps stand above the sample
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
    """Readings `values` (N, C) of f, radiance per irradiance facing the lamp, of known `variance`, as observations."""
    if np.ndim(values) != 2 or np.shape(values) != np.shape(variance) or len(values) != len(directions.to_lamp):
        shapes = f"{np.shape(values)} and variance of shape {np.shape(variance)}"
        raise hg.InputError(f"{len(directions.to_lamp)} directions, values of shape {shapes}: give (N, C) for both")
    facing = np.maximum(directions.to_lamp[:, 2:], LEAST_COSINE)
    table = hg.ReflectanceTable(*directions, np.asarray(values) / facing, np.asarray(variance) / facing**2)
    return table.observations()


def cosines_of(directions: Directions) -> hg.Cosines:
    """The four cosines (N, 1) of each pair."""
    return hg.ReflectanceTable(*directions, np.zeros((len(directions.to_lamp), 1))).cosines


def _pair(lamp: float, offset: float, way: float) -> tuple[tuple[float, float, float], Array]:
    """Lamp at the angle `lamp` from the normal towards −x; eye `offset` from its mirror direction."""
    mirror = np.array([np.sin(lamp), 0.0, np.cos(lamp)])
    down, aside = np.array([np.cos(lamp), 0.0, -np.sin(lamp)]), np.array([0.0, 1.0, 0.0])
    eye = np.cos(offset) * mirror + np.sin(offset) * (np.cos(way) * down + np.sin(way) * aside)
    return (-np.sin(lamp), 0.0, np.cos(lamp)), eye
