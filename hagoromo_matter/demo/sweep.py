"""Sweep: a photographic background, a floor that curves up into a wall without an edge."""

from __future__ import annotations

import numpy as np

from hagoromo.image.scene.surface import Surface
from hagoromo.reflectance.reflectance import Reflectance

BEND_FACETS = 48  # facets of the curved part


def sweep(
    reflectance: Reflectance, floor: tuple[float, float], wall: tuple[float, float], radius: float, half: float
) -> Surface:
    """A floor from y = floor[0] at height floor[1], curved by `radius` into a wall at y = wall[0] up to z = wall[1].

    It extends from −half to half along x. All lengths in metres.
    """
    turn = np.linspace(0.0, np.pi / 2, BEND_FACETS + 1)
    y = np.concatenate([[floor[0]], wall[0] - radius + radius * np.sin(turn), [wall[0]]])
    z = np.concatenate([[floor[1]], floor[1] + radius * (1.0 - np.cos(turn)), [max(wall[1], floor[1] + 1.01 * radius)]])
    vertices = np.array([(x, *place) for x in (-half, half) for place in zip(y, z, strict=True)])
    count, k = len(y), np.arange(len(y) - 1)
    faces = np.concatenate([np.stack(f, axis=1) for f in ((k, k + count, k + 1), (k + 1, k + count, k + count + 1))])
    return Surface(reflectance, vertices=vertices, faces=faces, name="sweep")
