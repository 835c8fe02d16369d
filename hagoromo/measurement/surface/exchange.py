"""Exchange: how much of the light that leaves one part of a surface arrives at another, from points and normals.

Enters: points and normals of the pixels of one view. Leaves: patches of the surface, and the light that they send to
each pixel, given what leaves them: E_i = Σ_j V_ij L_j cosθ_i cosθ_j A_j / (r² + A_j / π), a patch being a disc. Only
what the camera sees is known of the surface, so that E is a lower bound.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.camera import Camera
from hagoromo.measurement.nearest import nearest_known
from hagoromo.measurement.normals.views import Array

MOST_PATCHES = 900
LEAST_COVERED = 0.3  # share of a square of pixels that has a surface, for it to be a patch
SMALLEST_COSINE = 0.1  # to the eye, of a patch whose area is wanted
ALONG = 8  # places between two patches at which the surface may be in the way
BIAS = 0.5  # of a patch's width, by which the surface must be in the way


@dataclass(frozen=True, eq=False)
class Exchange:
    """N patches of a surface of h × w pixels: matrix (N, N) E_i per L_j [sr]; step: their side [px].

    places: (N, 2) rows and columns of the patches in the grid of `shape`. known: (h, w) pixels with a surface.
    """

    matrix: Array
    step: int
    places: tuple[NDArray[np.intp], NDArray[np.intp]]
    shape: tuple[int, int]
    known: NDArray[np.bool_]

    def patches(self, image: NDArray[np.floating]) -> Array:
        """(N, C) means of an image (h, w, C) over the pixels of each patch with a surface."""
        return _means(image, self.known, self.step)[self.places]

    def pixels(self, values: Array) -> Array:
        """(h, w, C) of values (N, C) of the patches: linear between their centres."""
        from scipy.ndimage import map_coordinates

        height, width = self.known.shape
        grid, there = np.zeros((*self.shape, values.shape[1])), np.zeros(self.shape, bool)
        grid[self.places], there[self.places] = values, True
        grid = grid[nearest_known(there)]
        at = [(np.arange(size) + 0.5) / self.step - 0.5 for size in (height, width)]
        where = np.meshgrid(*at, indexing="ij")
        found = [np.asarray(map_coordinates(one, where, order=1, mode="nearest")) for one in np.moveaxis(grid, 2, 0)]
        return np.where(self.known[..., None], np.stack(found, axis=2), 0.0)


def exchange(points: NDArray[np.floating], normals: NDArray[np.floating], camera: Camera) -> Exchange:
    """The exchange of light over points (h, w, 3) with normals (h, w, 3), 0 where unknown, seen by `camera`."""
    known = np.asarray(np.linalg.norm(normals, axis=2) > 0.5) & (np.linalg.norm(points, axis=2) > 0.0)
    step = max(int(np.ceil(np.sqrt(known.sum() / MOST_PATCHES))), 1)
    covered = _means(np.ones((*known.shape, 1)), np.ones_like(known), step, known)[..., 0]
    places = np.nonzero(covered >= LEAST_COVERED)
    area = _areas(points, normals, camera, known)
    at, facing = (_means(one, known, step)[places] for one in (points.astype(np.float64), normals.astype(np.float64)))
    facing /= np.maximum(np.linalg.norm(facing, axis=1, keepdims=True), 1e-12)
    # the area of the pixels that are known: their mean times their number
    size = _means(area[..., None], known, step)[..., 0][places] * covered[places] * step**2
    apart = at[None] - at[:, None]  # from i to j
    squared = np.einsum("ijk,ijk->ij", apart, apart)
    distance = np.sqrt(np.maximum(squared, 1e-300))
    at_receiver = np.einsum("ijk,ik->ij", apart, facing) / distance
    at_sender = -np.einsum("ijk,jk->ij", apart, facing) / distance
    matrix = np.maximum(at_receiver, 0.0) * np.maximum(at_sender, 0.0) * size / (squared + size / np.pi)
    np.fill_diagonal(matrix, 0.0)
    pairs = np.nonzero(matrix > 0.0)
    matrix[pairs] *= _visible(places, covered.shape, at, np.sqrt(size), camera, pairs)
    return Exchange(matrix, step, (places[0], places[1]), (covered.shape[0], covered.shape[1]), known)


def _visible(
    places: tuple[NDArray[np.intp], ...],
    shape: tuple[int, ...],
    points: Array,
    width: Array,
    camera: Camera,
    pairs: tuple[NDArray[np.intp], ...],
) -> NDArray[np.bool_]:
    """Whether no part of the surface is in the way of each of `pairs` of patches, in the view of the camera."""
    depth = (points - camera.position) @ camera.camera_to_world[:3, 2]
    grid = np.full(shape, np.inf)
    grid[places] = depth
    one, other = pairs
    free = np.ones(len(one), bool)
    for share in (np.arange(ALONG) + 0.5) / ALONG:
        row, column = (np.rint(part[one] * (1 - share) + part[other] * share).astype(np.intp) for part in places)
        # 1/depth is linear along a line in a picture
        along = 1.0 / ((1 - share) / depth[one] + share / depth[other])
        free &= grid[row, column] > along - BIAS * np.minimum(width[one], width[other])
    return free


def _areas(
    points: NDArray[np.floating], normals: NDArray[np.floating], camera: Camera, known: NDArray[np.bool_]
) -> Array:
    """(h, w) [m²] of the surface that each pixel sees, 0 where none is."""
    to_eye = camera.position - points
    distance = np.linalg.norm(to_eye, axis=2)
    cosine = np.einsum("hwi,hwi->hw", to_eye, normals) / np.maximum(distance, 1e-12)
    depth = -(to_eye @ camera.camera_to_world[:3, 2])
    facing = depth**2 / (camera.focal[0] * camera.focal[1])  # of a plane that faces the axis of the camera
    tilt = np.maximum(depth, 1e-12) / np.maximum(distance, 1e-12)  # cos of the ray to the axis
    return np.where(known, facing * tilt / np.maximum(cosine, SMALLEST_COSINE), 0.0)


def _means(
    image: NDArray[np.floating], weight: NDArray[np.bool_], step: int, counted: NDArray[np.bool_] | None = None
) -> Array:
    """(h/step, w/step, C) means of an image (h, w, C) over squares, of the pixels of `weight`; not `counted` is 0."""
    height, width = weight.shape
    edges = [np.arange(0, size, step) for size in (height, width)]
    of = np.where((weight if counted is None else weight & counted)[..., None], image, 0.0)
    sums = np.add.reduceat(np.add.reduceat(of, edges[0], axis=0), edges[1], axis=1)
    counts = np.add.reduceat(np.add.reduceat(weight.astype(np.float64), edges[0], axis=0), edges[1], axis=1)
    return sums / np.maximum(counts, 1.0)[..., None]
