"""Near surface: the nodes beside a surface, its places nearest to them, and how much matter is behind these.

A lattice holds what is some voxels thick. Of thinner matter both faces hang on the same nodes: neither can move by
itself, and one body colour stands for both.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from hagoromo.backend import Array3f, vectors

if TYPE_CHECKING:
    from hagoromo_recovery.field.distance_field import DistanceField

Array = NDArray[np.float64]

NEAR = 1.5  # voxels from the surface within which nodes are near it: all that are nearest to one of its places
NEWTON_STEPS, STEEP = 4, 0.1  # towards the surface; least |∇d|² that a step divides by
THICK = 3.5  # voxels: faces less than 3 apart hang on the same nodes, and are found half a voxel too far apart
INWARDS = 0.25  # voxels, of a step inwards
NEIGHBOURHOOD = 2.5  # voxels, radius of the means that errors are


class NearSurface:
    """nodes: (nz, ny, nx) those near the surface. places: (n, 3) of the surface, nearest to each [voxel]. normals:
    (n, 3) outwards.
    """

    def __init__(self, field: DistanceField) -> None:
        distance = field.distances()
        self.field, self.nodes = field, np.abs(distance) < NEAR
        places = on_surface(field, np.argwhere(self.nodes)[:, ::-1].astype(np.float64))
        slope = looked_up(field, vectors(places))[1]
        self.places = places
        self.normals = slope / np.maximum(np.linalg.norm(slope, axis=1, keepdims=True), 1e-12)

    @cached_property
    def around(self) -> list[list[int]]:
        """Of each place, the numbers of those within NEIGHBOURHOOD."""
        return KDTree(self.places).query_ball_point(self.places, NEIGHBOURHOOD)

    @cached_property
    def thin(self) -> NDArray[np.bool_]:
        """(n,) places with one within NEIGHBOURHOOD whose matter is thinner than THICK."""
        found = np.isfinite(self.thickness)
        return np.array([found[each].any() for each in self.around], bool)

    @cached_property
    def thickness(self) -> Array:
        """(n,) way along the inward normal to where the matter ends [voxel]; ∞ where that is more than THICK."""
        found = np.full(len(self.places), np.inf)
        before = np.zeros(len(self.places))
        for way in np.arange(INWARDS, THICK + INWARDS, INWARDS):
            value = np.array(self.field.value_at(vectors(self.places - way * self.normals)), np.float64)
            ends = np.isinf(found) & (value >= 0.0) & (before < 0.0)
            share = before[ends] / (before[ends] - value[ends])
            found[ends] = way - INWARDS + INWARDS * share
            before = value
        return np.where(found < THICK, found, np.inf)


def on_surface(field: DistanceField, places: Array) -> Array:
    """Places of the surface (n, 3) beside others [voxel], by Newton's steps along the slope."""
    for _ in range(NEWTON_STEPS):
        value, slope = looked_up(field, vectors(places))
        places = places - value[:, None] * slope / np.maximum((slope * slope).sum(axis=1, keepdims=True), STEEP)
    return places


def looked_up(field: DistanceField, at: Array3f) -> tuple[Array, Array]:
    """Distance [voxel] and its slope (n, 3) at lattice places."""
    return np.array(field.value_at(at), np.float64), np.array(field.axis_at(at), np.float64).T
