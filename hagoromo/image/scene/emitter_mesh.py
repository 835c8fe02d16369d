"""Emitter mesh: surfaces of a scene that give off light, as lights.

Exact round shapes become fine meshes, so that rays hit the triangles on which places are drawn.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from hagoromo.image.scene.surface import Surface
from hagoromo.light.emitting_surface import EmittingSurface


def emitters_of(surfaces: tuple[Surface, ...]) -> list[EmittingSurface]:
    """Those surfaces that give off light, in order, each light with its name or that of its surface."""
    return [
        EmittingSurface(
            number,
            replace(surface.emission, name=surface.emission.name or surface.name or f"surface {number + 1}"),
            partial(_triangles, surface),
        )
        for number, surface in enumerate(surfaces)
        if surface.emission is not None
    ]


def _triangles(surface: Surface) -> NDArray[np.float64]:
    """(n, 3, 3) corners in the world [m]."""
    vertices, faces = surface.triangles()
    return (vertices @ surface.pose[:3, :3].T + surface.pose[:3, 3])[faces]
