"""Dressed: clothes put on a figure one after the other; each lies on the body and on those before it. All in mm."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import arrays, lookup
from hagoromo.matter.shape import Shape
from hagoromo_matter.drape.collider import Collider
from hagoromo_matter.drape.cut import Cut
from hagoromo_matter.drape.settle import ClothMechanics, Fall, settled
from hagoromo_matter.drape.sheet import Sheet

DRESSING_SPACE_MM = (-75.0, -85.0, -4.0), (75.0, 75.0, 275.0)  # corners of the space in which a figure is dressed
LATTICE = 1.5
DRESSED_SPACING_MM = 1.2  # distance between the points of the sheets that are searched
DEEP = 7.0  # depth below the outer side of a cloth that counts as inside


def put_on(
    cuts: Sequence[Cut], bodies: Sequence[Shape], fabric: ClothMechanics, fall: Fall, common: Shape | None = None
) -> list[Sheet]:
    """The cuts at rest on a figure; the layer of a cut is the number of its body. common: a solid that is of all."""
    return settled(cuts, Collider(bodies, *DRESSING_SPACE_MM, LATTICE, common), fabric, fall)


def dressed(body: Shape, sheets: Sequence[Sheet]) -> Shape:
    """`body` and all that lies less than DEEP beneath the upper side of the sheets, as one solid."""
    from scipy.spatial import KDTree

    points, normals = (np.concatenate(parts) for parts in zip(*(_samples(sheet) for sheet in sheets), strict=True))
    tree, jit = KDTree(points), arrays()

    def shape(point: Any) -> Any:
        asked = np.array(point, np.float64).T
        # beyond the reach of the search the distance is at least DEEP; the body itself decides what is inside
        distance = np.full(len(asked), DEEP, np.float32)
        near = np.flatnonzero(_near(asked, points))
        asked = asked[near]
        far, nearest = tree.query(asked, distance_upper_bound=DEEP, workers=-1)
        found = np.flatnonzero(np.isfinite(far))
        far, nearest = far[found], np.asarray(nearest)[found]
        above = np.einsum("ij,ij->i", asked[found] - points[nearest], normals[nearest]) > 0
        distance[near[found]] = np.where(above, far, -far)
        cloth = lookup(jit.Float, distance)
        return dr.fmin(body(point), cloth)

    return shape


def _near(asked: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which of the places asked may lie within DEEP of any of the points: by cells of that size."""
    from scipy.ndimage import binary_dilation

    low = points.min(axis=0) - 2.0 * DEEP  # so that the outermost cells are empty: all places outside go to them
    cell = np.floor((points - low) / DEEP).astype(np.int32)
    held = np.zeros(cell.max(axis=0) + 3, bool)
    held[tuple(cell.T)] = True
    held = np.asarray(binary_dilation(held, np.ones((3, 3, 3), bool)), bool)
    place = np.clip(np.floor((asked - low) / DEEP), 0, np.array(held.shape) - 1).astype(np.int32)
    return np.take(held, np.ravel_multi_index(tuple(place.T), held.shape))


def _samples(sheet: Sheet) -> tuple[np.ndarray, np.ndarray]:
    """Points of a sheet and their upper sides, (n, 3) each."""
    points = sheet.refined(max(1, round(sheet.spacing / DRESSED_SPACING_MM))).points
    if sheet.around:
        wrapped = np.concatenate([points[:, -1:], points, points[:, :1]], axis=1)
        across = np.gradient(wrapped, axis=1)[:, 1:-1]
    else:
        across = np.gradient(points, axis=1)
    normal = np.cross(across, np.gradient(points, axis=0)).reshape(-1, 3)
    return points.reshape(-1, 3), normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
