"""Object sky: what places of a surface see of the object itself in the sky above them."""

from __future__ import annotations

import drjit as dr
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.spatial import KDTree

from hagoromo.backend import arrays, evaluate, vectors
from hagoromo.matter.shape import unit
from hagoromo_recovery.field.distance_field import DistanceField
from hagoromo_recovery.field.matter_march import LatticeRays, MatterMarch
from hagoromo_recovery.field.near_surface import NearSurface

Array = NDArray[np.float64]
DIRECTIONS, MOST_PLACES = 64, 1 << 12  # above each place; places that are looked at
INSIDE = 1.0  # [voxel] from the edge of the lattice where rays end
ON_SURFACE = 0.75  # voxels from the surface within which nodes have places that are looked at
APART = 2.0  # voxels that places of right angles between their normals count as being apart, over √2
LEAST_OPACITY = 0.01  # of what a ray meets


class Unlit:
    """Shading without light, of marches that ask for ways alone."""

    channels = 0

    def __call__(self, *matter: object) -> list[object]:
        """No channel."""
        return []


class ObjectSky:
    """places: (n, 3) of the surface, evenly spread [voxel]. normals: (n, 3) outwards. near: all places that it has.

    receiver, sender: (m,) numbers of the places from which, and at which, rays meet the object. towards: (m, 3) from
    receiver to sender. opacity: (m,) of what they meet. DIRECTIONS rays go from each place, spread by the cosine: the
    irradiance of a place is π / DIRECTIONS times the sum of the radiance along them.
    """

    def __init__(self, march: MatterMarch) -> None:
        field = march.field
        assert isinstance(field, DistanceField)
        self.near = NearSurface(field)
        on = np.abs(field.distances()[self.near.nodes]) < ON_SURFACE
        some = np.flatnonzero(on if on.any() else np.ones_like(on))
        random = np.random.default_rng(0)
        some = np.sort(random.permutation(some)[:MOST_PLACES])
        self.places, self.normals = self.near.places[some], self.near.normals[some]
        self.tree = KDTree(_apart(self.places, self.normals))
        directions = above(self.normals, random.uniform(0.0, 2.0 * np.pi, len(some)))
        opacity, places, normals = met(march, self.places, directions)
        hit = np.flatnonzero(opacity > LEAST_OPACITY)
        self.receiver, self.towards, self.opacity = hit // DIRECTIONS, directions[hit], opacity[hit]
        self.sender = self.tree.query(_apart(places[hit], normals[hit]))[1].astype(np.int64)

    @property
    def count(self) -> int:
        """Places."""
        return len(self.places)

    def gathered(self, values: Array) -> Array:
        """(n, k) mean over the sky of places, by the cosine, of values (m, k) along the rays that meet the object."""
        rows = csr_array(
            (self.opacity / DIRECTIONS, (self.receiver, np.arange(len(self.receiver)))),
            (self.count, len(self.receiver)),
        )
        return np.asarray(rows @ values)

    def of_places(self) -> csr_array:
        """(n, n) share of the sky of each place that each other one takes."""
        return csr_array((self.opacity / DIRECTIONS, (self.receiver, self.sender)), (self.count, self.count))

    def to_near(self, values: Array, neighbours: int = 4) -> Array:
        """(near, k) values at all places near the surface, from those of places (n, k): means of the nearest ones."""
        count = min(neighbours, self.count)
        away, which = self.tree.query(_apart(self.near.places, self.near.normals), count)
        away, which = away.reshape(-1, count), which.reshape(-1, count)
        weights = 1.0 / (away**2 + 0.25)
        weights /= weights.sum(axis=1, keepdims=True)
        return np.asarray(np.einsum("nj,njk->nk", weights, values[which]))


def above(normals: Array, turns: Array) -> Array:
    """(n · DIRECTIONS, 3) unit directions above places, spread by the cosine. turns: (n,) about the normals [rad]."""
    aside = np.cross(normals, np.where(np.abs(normals[:, :1]) < 0.5, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]))
    aside /= np.linalg.norm(aside, axis=1, keepdims=True)
    other = np.cross(normals, aside)
    cos, sin = np.cos(turns)[:, None], np.sin(turns)[:, None]
    frame = np.stack([cos * aside + sin * other, cos * other - sin * aside, normals], axis=1)
    return np.einsum("dk,nkj->ndj", cosine_directions(DIRECTIONS), frame).reshape(-1, 3)


def met(march: MatterMarch, places: Array, directions: Array) -> tuple[Array, Array, Array]:
    """Opacity (n · each,), and the mean places and unit normals (n · each, 3), of what rays meet: `each` direction
    (n · each, 3) above each place (n, 3).
    """
    jit, each = arrays(), len(directions) // len(places)
    place, direction = vectors(np.repeat(places, each, axis=0)), vectors(directions)
    rays = LatticeRays(place, direction, jit.Float(0), march.field.way_to_edge(place, direction, INSIDE))
    with dr.suspend_grad():
        seen = march.seen(rays)
        evaluate(seen)
        there = rays.at(seen.way)
        normal = unit(march.field.axis_at(there))
        dr.eval(there, normal)
    opacity = 1.0 - np.exp(-np.array(seen.depth, np.float64))
    return opacity, np.array(there, np.float64).T, np.array(normal, np.float64).T


def cosine_directions(count: int) -> Array:
    """(count, 3) directions about the z axis, evenly spread by their cosine to it (Fibonacci)."""
    number = np.arange(count) + 0.5
    radius, angle = np.sqrt(number / count), np.pi * (3.0 - np.sqrt(5.0)) * number
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), np.sqrt(1.0 - radius**2)], axis=1)


def _apart(places: Array, normals: Array) -> Array:
    """Coordinates (n, 6) in which both faces of thin matter are far from each other."""
    return np.concatenate([places, APART * normals], axis=1)
