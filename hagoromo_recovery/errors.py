"""Errors of places: how far surface, normals and body colours may be from the truth.

Every second photograph gives an object of its own, and the others give another one. Half of the difference between both
is the standard error of what all photographs give together. It holds noise, and faults of model, lamps and poses that
differ from photograph to photograph. Two objects say little of one place, so the square is a mean over the
neighbourhood. Both objects share the error of the lattice. The edge of the surface is soft by a share of a voxel, so
the position has an error in proportion to the voxel: it is as large as what the last halving of the voxel changed
(Richardson 1911), and is added. Tufts and locks of fuzzy matter are finer than voxels, so its normals and body colours
have such an error, too. Where matter is thinner than the lattice holds, no error is stated. What all photographs share,
such as a wrong scale, is in none.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import vectors
from hagoromo_recovery.field.matter_field import COLOURS
from hagoromo_recovery.field.near_surface import STEEP, NearSurface, looked_up
from hagoromo_recovery.shading.mixed_gloss import mixed_gloss
from hagoromo_recovery.surface_shape import SurfaceShape

Array = NDArray[np.float64]


class OnSurface(NamedTuple):
    """Of places: signed distance [m], unit normals (n, 3), body colours (n, 3), ln β and ln γ (n, 2) if they vary."""

    distance: Array
    normals: Array
    colours: Array
    gloss: Array


@dataclass(frozen=True, eq=False)
class Errors:
    """Standard errors of the nodes near the surface, NaN elsewhere.

    position: (nz, ny, nx) along the normal [m]. normal: (nz, ny, nx) root of the mean square angle [rad]. colour:
    (nz, ny, nx, 3) of body colours, NaN also where no photograph shows them lit. thin: (nz, ny, nx) nodes near the
    surface of matter that is too thin for the lattice: there none is stated, as both halves share what is wrong.
    of_lattice: whether the error of the lattice is in them: not, where there was one level of it. gloss: (nz, ny, nx,
    2) of ln β and ln γ; None: the object has one gloss.
    """

    position: NDArray[np.float32]
    normal: NDArray[np.float32]
    colour: NDArray[np.float32]
    thin: NDArray[np.bool_]
    of_lattice: bool = True
    gloss: NDArray[np.float32] | None = None

    def where_lit(self, photographs: NDArray[np.integer]) -> Errors:
        """With those of body colours where photographs show them: elsewhere nothing is known, and both halves agree."""
        return replace(self, colour=np.where(photographs[..., None] > 0, self.colour, np.float32(np.nan)))

    def with_doubt(self, doubt: float) -> Errors:
        """With a further standard error of all positions [m]."""
        return replace(self, position=np.hypot(self.position, np.float32(doubt)))

    def with_colour_doubt(self, doubt: NDArray[np.floating] | float) -> Errors:
        """With a further standard error of body colours, (nz, ny, nx, 3) or of all."""
        return replace(self, colour=np.hypot(self.colour, np.asarray(doubt, np.float32)))

    def counted_back(self, unit: float) -> Errors:
        """With those of body colours that were counted in a unit."""
        return replace(self, colour=(self.colour * unit).astype(np.float32))


def errors_of(
    found: SurfaceShape, halves: Sequence[SurfaceShape], before: SurfaceShape | None, fuzzy: bool = False
) -> Errors:
    """Errors of what was found. halves: what each half of the photographs gives. before: found one level earlier.

    fuzzy: whether the surface stands for fuzzy matter.
    """
    near = NearSurface(found.field())
    places = found.lattice.to_world(near.places)
    first, second = (_surface(each, places) for each in halves)
    position = 0.25 * (first.distance - second.distance) ** 2
    normal = 0.25 * _angles(first.normals, second.normals) ** 2
    colour, gloss = 0.25 * (first.colours - second.colours) ** 2, 0.25 * (first.gloss - second.gloss) ** 2
    if before is not None:
        own, coarse = _surface(found, places), _surface(before, places)
        position += coarse.distance**2
        gloss += (own.gloss - coarse.gloss) ** 2
        if fuzzy:
            normal += _angles(own.normals, coarse.normals) ** 2
            colour += (own.colours - coarse.colours) ** 2
    squares = np.concatenate([position[:, None], normal[:, None], colour, gloss], axis=1)
    error = np.sqrt([squares[each].mean(axis=0) for each in near.around])
    maps = np.full((*near.nodes.shape, error.shape[1]), np.nan, np.float32)
    thin = np.zeros(near.nodes.shape, bool)
    if not fuzzy:
        error[near.thin], thin[near.nodes] = np.nan, near.thin
    maps[near.nodes] = error
    of_gloss = maps[..., 2 + COLOURS :] if gloss.size else None
    return Errors(maps[..., 0], maps[..., 1], maps[..., 2 : 2 + COLOURS], thin, before is not None, of_gloss)


def _surface(shape: SurfaceShape, places: Array) -> OnSurface:
    """What an object has at places of the world (n, 3) [m]."""
    field, at = shape.field(), vectors(shape.lattice.from_world(places))
    distance, slope = looked_up(field, at)
    length = np.linalg.norm(slope, axis=1, keepdims=True)
    normals = slope / np.maximum(length, 1e-12)
    distance = distance / np.maximum(length[:, 0], STEEP**0.5)  # near the surface its slope is 1.5 and more
    colours = np.stack([np.array(each, np.float64) for each in field.colours_at(at)], axis=1)
    gloss = np.zeros((len(places), 0))
    if field.shares is not None:
        gloss = np.log(mixed_gloss(shape.gloss, np.array(field.share_at(at)))).T
    return OnSurface(distance * shape.lattice.voxel, normals, colours, gloss)


def _angles(first: Array, second: Array) -> Array:
    """Angles between unit vectors [rad]."""
    return 2.0 * np.arcsin(np.clip(0.5 * np.linalg.norm(first - second, axis=1), 0.0, 1.0))
