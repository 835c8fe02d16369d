"""Chords: by how much neighbouring pixels differ in depth, from their normals.

Between two points of a circle the chord is square to the sum of their normals. So the points P = z v on the rays v of
neighbouring pixels have (n_i + n_j) · (P_j − P_i) = 0, and with u = ln z

    u_j − u_i = ln (m·v_i) − ln (m·v_j),   m = n_i + n_j.

It is exact on planes and spheres, in perspective as in an orthographic view, up to their rims. A mean of both slopes
(the trapezoidal rule) is off there, always to the same side. What the rule is off by where normals do not turn evenly,
as at an edge whose place between the pixels is not known, is BEND times their unevenness.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.camera import Camera

Array = NDArray[np.float64]

STEEPEST = 0.05  # smallest |n·v|/|v|: beyond 87° a slope is that of the edge, not of the surface
SHARPEST = 1e-6  # [rad²] smallest variance of a normal
UNSTATED = 1e-4  # [rad²] variance of normals of which none is stated
BEND = 0.2  # standard deviation of the place of an edge between two pixels, of their distance
LONGEST = 0.9  # of half the relative step of depth between neighbours
NEIGHBOURS = (np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1, :], np.s_[1:, :])  # both pixels of each chord, along an axis


@dataclass(frozen=True, eq=False)
class Chords:
    """E chords of the pixels of `known` (h, w), in the order of NEIGHBOURS.

    pair: (E, 2) numbers of the known pixels. wanted: (E,) differences of ln depth. slope: (E, 3) of them by a change of
    either normal, camera axes. rule: (E,) their standard deviation by the rule alone.
    """

    known: NDArray[np.bool_]
    pair: NDArray[np.intp]
    wanted: Array
    slope: Array
    rule: Array

    @cached_property
    def index(self) -> NDArray[np.intp]:
        """(h, w) numbers of the known pixels, −1 of others."""
        return numbered(self.known)

    def of_errors(self, errors: Array) -> Array:
        """(E,) changes by changes of the normals (P, 3), camera axes."""
        return np.einsum("ei,ei->e", self.slope, errors[self.pair[:, 0]] + errors[self.pair[:, 1]])

    def by_normals(self, by_differences: Array) -> Array:
        """(P, 3) derivatives by the normals, camera axes, of what has the derivatives `by_differences` (E,)."""
        found = np.zeros((int(self.known.sum()), 3))
        for end in (0, 1):
            np.add.at(found, self.pair[:, end], by_differences[:, None] * self.slope)
        return found

    def variance(self, of_normals: Array) -> Array:
        """(E,) by that of the normals (P,) [rad²], the sum of two turns, and by the rule."""
        both = of_normals[self.pair[:, 0]] + of_normals[self.pair[:, 1]]
        return 0.5 * np.sum(self.slope**2, axis=1) * both + self.rule**2


def chords(
    normals: NDArray[np.floating], camera: Camera, known: NDArray[np.bool_], variance: NDArray[np.floating] | None
) -> Chords:
    """The chords between `known` neighbours with `normals` (h, w, 3), world axes, of this `variance` (h, w) [rad²]."""
    turned = np.where(known[..., None], normals, 0.0).astype(np.float64) @ camera.world_to_camera[:3, :3].T
    of_angle = normal_variance(known, variance)
    index = numbered(known)
    parts = [_along(axis, turned, camera, known, index, of_angle) for axis in (0, 1)]
    pair, wanted, slope, rule = (np.concatenate(part) for part in zip(*parts, strict=True))
    return Chords(known, pair, wanted, slope, rule)


def numbered(known: NDArray[np.bool_]) -> NDArray[np.intp]:
    """(h, w) numbers of the known pixels, in the order of rows, −1 of others."""
    index = np.full(known.shape, -1)
    index[known] = np.arange(known.sum())
    return index


def normal_variance(known: NDArray[np.bool_], variance: NDArray[np.floating] | None) -> Array:
    """(h, w) variance of normals [rad²], at least SHARPEST."""
    if variance is None:
        return np.full(known.shape, UNSTATED)
    return np.maximum(np.where(known, variance, UNSTATED), SHARPEST).astype(np.float64)


def rays(camera: Camera, rows: NDArray[np.intp], columns: NDArray[np.intp]) -> Array:
    """(P, 3) rays of depth 1 in the camera's frame."""
    x = (columns + 0.5 - camera.principal[0]) / camera.focal[0]
    y = (rows + 0.5 - camera.principal[1]) / camera.focal[1]
    return np.stack([x, y, np.ones_like(x)], axis=1).astype(np.float64)


def _along(
    axis: int, normals: Array, camera: Camera, known: NDArray[np.bool_], index: NDArray[np.intp], variance: Array
) -> tuple[NDArray[np.intp], Array, Array, Array]:
    """pair, wanted, slope and rule of the chords along the columns (0) or rows (1)."""
    first, second = NEIGHBOURS[axis]
    both = known[first] & known[second]
    pair = np.stack([index[first][both], index[second][both]], axis=1)
    rows, columns = np.nonzero(both)
    ray = rays(camera, rows, columns)
    step = 1.0 / camera.focal[axis]
    m = normals[first][both] + normals[second][both]
    middle = np.einsum("ei,ei->e", m, ray) + 0.5 * m[:, axis] * step
    length = np.linalg.norm(ray, axis=1) * np.linalg.norm(m, axis=1)
    towards = np.minimum(middle, -STEEPEST * length)
    # half the relative change of m·v along the chord; 0/0 where both normals are opposite
    half = np.clip(0.5 * m[:, axis] * step / np.minimum(towards, -1e-12), -LONGEST, LONGEST)
    wanted = np.log1p(-half) - np.log1p(half)
    by_half = -2.0 / (1.0 - half**2) / np.minimum(towards, -1e-12)
    ray[:, axis] += 0.5 * step
    slope = -by_half[:, None] * half[:, None] * ray
    slope[:, axis] += by_half * 0.5 * step
    slope[middle > towards] = 0.0
    slope[middle > towards, axis] = (by_half * 0.5 * step)[middle > towards]
    uneven, of_noise = _unevenness(axis, normals, both, 0.5 * variance)
    bend = np.einsum("ei,ei->e", slope, uneven[both])
    noise = np.sum(slope**2, axis=1) * of_noise[both]
    return pair, wanted, slope, 2.0 * BEND * np.sqrt(np.maximum(bend**2 - noise, 0.0))


def _unevenness(axis: int, normals: Array, both: NDArray[np.bool_], variance: Array) -> tuple[Array, Array]:
    """By how much the change of normals from a pixel to the next differs from the mean of those before and after it, as
    images of the chords (·, ·, 3), and the variance of a component of it by noise of the normals, `variance` (h, w).

    Where there is one of those, from that; the change itself where there is none.
    """
    first, second = NEIGHBOURS[axis]
    change = np.where(both[..., None], normals[second] - normals[first], 0.0)
    along = 1 - axis
    before, after = (_moved(change, along, by) for by in (1, -1))
    has_before, has_after = (_moved(both, along, by) for by in (1, -1))
    count = has_before.astype(np.float64) + has_after
    uneven = change - (before + after) / np.maximum(count, 1.0)[..., None]
    # squares of the weights of the two pixels, and of those beyond: 1; 2 and 1; 3/2 and 1/2
    inner, outer = np.choose(count.astype(np.intp), (2.0, 5.0, 4.5)), np.choose(count.astype(np.intp), (0.0, 1.0, 0.5))
    near = 0.5 * (variance[first] + variance[second])
    return uneven, (inner + outer) * near


def _moved(image: NDArray, axis: int, step: int) -> NDArray:
    """The image of the neighbours along an axis, 0 beyond the border."""
    moved = np.zeros_like(image)
    to, of = (np.s_[1:], np.s_[:-1]) if step > 0 else (np.s_[:-1], np.s_[1:])
    moved[(slice(None),) * axis + (to,)] = image[(slice(None),) * axis + (of,)]
    return moved
