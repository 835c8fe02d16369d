"""Footprint: by how much the width of the pixels smooths a surface that was integrated from normals.

A pixel sees the mean of the normals in it, and the rule of chords takes the mean of two such: a wave of k radians a
pixel keeps 1 − k²/8 of its height along an axis and 1 − k²/12 aslant: grooves come out shallower. A surface that bends
evenly is exact (`chords`). What counts is the unevenness of bending: second differences of ln distance, less
their mean around. A ninth of it gives most of what was lost back; what is left, and what interpolation between pixels
smooths, 0 to 1/8 of it along each axis, is an error.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from hagoromo.camera.camera import Camera
from hagoromo.measurement.surface.chords import NEIGHBOURS, STEEPEST, chords

Array = NDArray[np.float64]
LOST = 1.0 / 9.0  # of the unevenness: between 1/8 and 1/12
LEFT = 0.13  # standard deviation of what is left, of the unevenness where the surface faces the camera
EVEN, NEAR = 17, 3  # [px] sides of the squares over which bending is even, and over which `LEFT` is averaged


class Unevenness(NamedTuple):
    """bend: (h, w) second differences of ln distance, less their mean around; noise: its variance by the normals'.
    facing: (h, w) cosine of the normal to the line of sight: of steep pixels, parts that face away are seen least.
    """

    bend: Array
    noise: Array
    facing: Array
    known: NDArray[np.bool_]

    @property
    def lost(self) -> Array:
        """(h, w) of ln distance, that smoothing took away."""
        return -LOST * self.bend

    @property
    def left(self) -> Array:
        """(h, w) standard deviation of ln distance, 0 where unknown."""
        power = _mean((self.bend**2 - self.noise) / np.maximum(self.facing, STEEPEST) ** 2, self.known, NEAR)
        return LEFT * np.sqrt(np.where(self.known, np.maximum(power, 0.0), 0.0))


def unevenness(
    normals: NDArray[np.floating], camera: Camera, known: NDArray[np.bool_], variance: NDArray[np.floating]
) -> Unevenness:
    """Of `normals` (h, w, 3), world axes, of this own `variance` (h, w) [rad²]."""
    found = chords(normals, camera, known, variance)
    bend, noise, start = np.zeros(known.shape), np.zeros(known.shape), 0
    for axis, (first, second) in enumerate(NEIGHBOURS):
        both = known[first] & known[second]
        end, step, steep = start + int(both.sum()), np.zeros(both.shape), np.zeros(both.shape)
        step[both], steep[both] = found.wanted[start:end], np.sum(found.slope[start:end] ** 2, axis=1)
        start = end
        before, middle, after = (_along(axis, part) for part in (np.s_[:-2], np.s_[1:-1], np.s_[2:]))
        left, right = (_along(axis, part) for part in (np.s_[:-1], np.s_[1:]))
        whole = both[left] & both[right]
        bend[middle] += np.where(whole, step[right] - step[left], 0.0)
        noise[middle] += np.where(
            whole, 0.25 * (steep[left] + steep[right]) * (variance[before] + variance[after]), 0.0
        )
    facing = np.where(known, -np.einsum("hwi,hwi->hw", normals, camera.pixel_directions()), 1.0)
    return Unevenness(np.where(known, bend - _mean(bend, known, EVEN), 0.0), noise, facing, known)


def _along(axis: int, part: slice) -> tuple[slice, slice]:
    """`part` of the columns (axis 0) or of the rows (1)."""
    return (np.s_[:], part) if axis == 0 else (part, np.s_[:])


def _mean(image: Array, known: NDArray[np.bool_], side: int) -> Array:
    """(h, w) means over the known pixels of squares."""
    total, weight = (uniform_filter(one, side, mode="constant") for one in (image * known, known.astype(np.float64)))
    return np.asarray(total / np.maximum(weight, 1e-9), np.float64)
