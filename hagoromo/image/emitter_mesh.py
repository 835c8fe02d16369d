"""Emitter meshes: the triangles of surfaces that give off light, as rays hit them and as places on them are drawn.

Exact round shapes become fine meshes, so that both are the same.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.image.surface import Surface
from hagoromo.light.surface_emission import SurfaceEmission


class Emitter(NamedTuple):
    """A surface that gives off light: its number among the surfaces, corners (n, 3, 3) [m], and the emission."""

    surface: int
    corners: NDArray[np.float64]
    emission: SurfaceEmission


def emissions_of(surfaces: tuple[Surface, ...]) -> list[SurfaceEmission]:
    """The lights of those surfaces that give off light, in order, each with its name or that of its surface."""
    return [
        replace(surface.emission, name=surface.emission.name or surface.name or f"surface {number + 1}")
        for number, surface in enumerate(surfaces)
        if surface.emission is not None
    ]


def emitters_of(surfaces: tuple[Surface, ...]) -> list[Emitter]:
    """Those surfaces that give off light, in order."""
    numbers = [number for number, surface in enumerate(surfaces) if surface.emission is not None]
    found = []
    for number, emission in zip(numbers, emissions_of(surfaces), strict=True):
        vertices, faces = surfaces[number].triangles()
        corners = (vertices @ surfaces[number].pose[:3, :3].T + surfaces[number].pose[:3, 3])[faces]
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        found.append(Emitter(number, corners[np.linalg.norm(across, axis=1) > 0.0], emission))
    return found
