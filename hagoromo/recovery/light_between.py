"""Light between parts: how much of the light of a place comes from other parts of the object, by its form and colours.

The model knows the light of lamps alone. Where a part of the sky above a place is the object itself, and white, what
comes from there brightens the place, and its body colour explains it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import arrays, vectors
from hagoromo.recovery.matter_march import LatticeRays, MatterMarch

if TYPE_CHECKING:
    from hagoromo.recovery.recovered import Recovered

Array = NDArray[np.float64]
DIRECTIONS, MOST_PLACES = 64, 1 << 12  # above each place; places that are looked at
INSIDE = 1.0  # [voxel] from the edge of the lattice where rays end


def light_between(recovered: Recovered) -> Array:
    """(n,) light from other parts over that of lamps, of places of the surface, if all parts are lit alike.

    A place that sees the share s of its sky, by the cosine, as object of the albedo ρ has ρ s / (1 − ρ s): all bounces,
    if what it sees is as white and sees as much.
    """
    near = recovered.near_surface
    some = np.random.default_rng(0).permutation(len(near.places))[:MOST_PLACES]
    seen = object_seen(recovered.rendering.march, near.places[some], near.normals[some])
    colours = np.stack([np.array(c) for c in near.field.colours_at(vectors(near.places[some]))], axis=1)
    part = np.clip(recovered.dim * colours.mean(axis=1), 0.0, 1.0) * seen
    return part / (1.0 - np.minimum(part, 0.9))


def object_seen(march: MatterMarch, places: Array, normals: Array) -> Array:
    """(n,) share of the sky of places (n, 3) [voxel] that is the object itself, by the cosine to their normals."""
    jit, field, ways = arrays(), march.field, cosine_directions(DIRECTIONS)
    aside = np.cross(normals, np.where(np.abs(normals[:, :1]) < 0.5, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]))
    aside /= np.linalg.norm(aside, axis=1, keepdims=True)
    frame = np.stack([aside, np.cross(normals, aside), normals], axis=1)
    directions = np.einsum("dk,nkj->ndj", ways, frame).reshape(-1, 3)
    place, direction = vectors(np.repeat(places, DIRECTIONS, axis=0)), vectors(directions)
    rays = LatticeRays(place, direction, jit.Float(0), field.way_to_edge(place, direction, INSIDE))
    passed = np.array(march.transmittance(rays), np.float64).reshape(-1, DIRECTIONS)
    return 1.0 - passed.mean(axis=1)


def cosine_directions(count: int) -> Array:
    """(count, 3) directions about the z axis, evenly spread by their cosine to it (Fibonacci)."""
    number = np.arange(count) + 0.5
    radius, angle = np.sqrt(number / count), np.pi * (3.0 - np.sqrt(5.0)) * number
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), np.sqrt(1.0 - radius**2)], axis=1)
