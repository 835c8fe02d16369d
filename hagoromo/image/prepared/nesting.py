"""Nesting of glass: which glass lies in which, and what stands in one. Glass is closed and touches no other glass."""

from __future__ import annotations

from collections.abc import Sequence

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import arrays, opaque_vector
from hagoromo.errors import InputError
from hagoromo.image.prepared.traced_surfaces import Surfaces
from hagoromo.image.scene.surface import Surface

CLOSED_SHAPES = ("sphere", "cube")
SAMPLES = 64  # places of a glass that must all lie within another one, or none
MOST_CROSSINGS = 256  # of one glass, along a ray
WAY = np.array([0.26726, 0.53452, 0.80178])  # of the rays: along no axis


class Glass:
    """The glass surfaces of a scene, by their numbers among its surfaces."""

    def __init__(self, surfaces: Sequence[Surface], origin: NDArray[np.float64]) -> None:
        """origin: (3,) [m], from which places are counted. `InputError` for glass that is open or crosses another."""
        self.surfaces, self.origin = surfaces, origin
        self.numbers = [number for number, surface in enumerate(surfaces) if surface.optics == "glass"]
        for number in self.numbers:
            if not is_closed(surfaces[number]):
                raise InputError(
                    f"surface {surfaces[number].name!r} is glass and has an open edge: give a closed mesh, a sphere or "
                    "a cube"
                )
        self.hits = {number: Surfaces([surfaces[number]], origin) for number in self.numbers}
        self.around = self._around()

    def holding(self, places: NDArray[np.float64]) -> list[Surface | None]:
        """A glass around each of some places (n, 3) [m], world; None in air."""
        held: list[Surface | None] = [None] * len(places)
        for number in self.numbers:
            for place in np.flatnonzero(self._within(number, places)):
                held[place] = self.surfaces[number]
        return held

    def _around(self) -> dict[int, int | None]:
        """The innermost glass around each; None: air."""
        holders: dict[int, list[int]] = {number: [] for number in self.numbers}
        for one in self.numbers:
            places = places_on(self.surfaces[one])
            for other in self.numbers:
                if one == other:
                    continue
                within = self._within(other, places)
                if within.any() != within.all():
                    raise InputError(
                        f"the glass of surface {self.surfaces[one].name!r} crosses that of "
                        f"{self.surfaces[other].name!r}: put it wholly within or beside"
                    )
                if within.all():
                    holders[one].append(other)
        return {
            one: max(around, key=lambda other: len(holders[other]), default=None) for one, around in holders.items()
        }

    def _within(self, number: int, places: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether places (n, 3) [m], world, lie within a glass: a ray from there crosses it an odd number of times."""
        jit, glass = arrays(), self.hits[number]
        origin = jit.Array3f(np.ascontiguousarray((places - self.origin).T, np.float32))
        way, crossings = opaque_vector(WAY), np.zeros(len(places), int)
        for _ in range(MOST_CROSSINGS):
            distance, *_ = glass.hit(origin, way)
            hit = np.isfinite(np.array(distance))
            crossings += hit
            if not hit.any():
                break
            origin = dr.fma(way, dr.select(dr.isfinite(distance), distance + 2.0 * glass.shadow_bias, 0.0), origin)
            dr.eval(origin)
        return crossings % 2 == 1


def is_closed(surface: Surface) -> bool:
    """Whether a surface has an inside: of a mesh, every edge belongs to two faces, wherever vertices coincide."""
    if surface.vertices is None or surface.faces is None:
        return surface.shape in CLOSED_SHAPES
    _, same = np.unique(np.asarray(surface.vertices), axis=0, return_inverse=True)
    faces = np.sort(same.reshape(-1)[np.asarray(surface.faces)], axis=1)
    faces = faces[(faces[:, 0] < faces[:, 1]) & (faces[:, 1] < faces[:, 2])]
    _, count = np.unique(faces[:, [0, 1, 1, 2, 0, 2]].reshape(-1, 2), axis=0, return_counts=True)
    return bool(len(count) and (count % 2 == 0).all())


def places_on(surface: Surface) -> NDArray[np.float64]:
    """Some places on a closed surface, world [m]: (n, 3)."""
    if surface.vertices is not None:
        vertices = np.asarray(surface.vertices, float)
        local = vertices[np.unique(np.linspace(0, len(vertices) - 1, SAMPLES).astype(int))]
    else:
        steps = np.array([(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if x or y or z], float)
        local = steps / np.linalg.norm(steps, axis=1)[:, None] if surface.shape == "sphere" else steps
    return local @ surface.pose[:3, :3].T + surface.pose[:3, 3]
