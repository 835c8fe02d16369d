"""Occlusion: the share of the sky over each pixel that the surface around it leaves open.

O = 1/π ∫ V(ω) max(n·ω, 0) dω, with V(ω) 0 where the surface hides the direction ω and 1 where it is open: 1 on a plane
and on all that bulges, less in grooves and cracks. The sky is weighted by the cosine to the normal, as a cloudy sky
lights a matt body (ambient occlusion, Zhukov, Iones & Kronin 1998).

Planes through the line of sight cut the surface in straight lines of the picture. In each half plane the directions up
to the horizon are open, from the line of sight to the angle h, and the integral over them is
½ n_e sin²h + n_t (½ h − ¼ sin 2h), n_e along the line of sight and n_t across it (Jiménez et al. 2016, "Practical
real-time strategies for accurate indirect occlusion"). What lies behind something that the camera sees counts as solid.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hagoromo.measurement.inspection.seen_surface import SeenSurface
from hagoromo.measurement.nearest import nearest_known
from hagoromo.measurement.surface.horizon import BELOW, SeenRelief
from hagoromo.progress import Progress, silent

Array = NDArray[np.float64]
DIRECTIONS = 32  # half planes


def occlusion(surface: SeenSurface, directions: int = DIRECTIONS, progress: Progress = silent) -> Array:
    """(h, w) open share of the sky, 0 … 1, NaN where unknown. directions: number of half planes."""
    rows, columns = np.nonzero(surface.known)
    pixels = rows, columns
    relief = SeenRelief(np.where(surface.known[..., None], surface.points, 0.0), surface.camera, pixels)
    ray = surface.camera.pixel_directions()
    turns = [np.gradient(ray, axis=axis)[pixels] for axis in (1, 0)]
    to_eye, normal = -ray[pixels], surface.normals[pixels]
    along = np.einsum("pi,pi->p", normal, to_eye)
    total, norm = np.zeros(len(along)), np.zeros(len(along))
    for k in range(directions):
        progress(k / directions, "occlusion")
        angle = 2.0 * np.pi * k / directions
        step = np.array([np.cos(angle), np.sin(angle)])
        across = step[0] * turns[0] + step[1] * turns[1]
        across -= np.einsum("pi,pi->p", across, to_eye)[:, None] * to_eye
        length = np.linalg.norm(across, axis=1)
        share = 1.0 / length**2  # of the angle about the line of sight that an angle in the picture is
        aside = np.einsum("pi,pi->p", normal, across) / length
        total += share * _open(relief.highest(np.tile(step, (len(along), 1))), along, aside)
        norm += share
    progress(1.0, "")
    found = np.full(surface.known.shape, np.nan)
    found[pixels] = np.clip(2.0 * total / norm, 0.0, 1.0)
    return found


def coarse_occlusion(surface: SeenSurface, most_pixels: int, directions: int = DIRECTIONS) -> Array:
    """`occlusion` of a surface of `most_pixels` at most, of means over squares of pixels, at every pixel."""
    from scipy.ndimage import map_coordinates

    step = max(int(np.ceil(np.sqrt(surface.known.sum() / most_pixels))), 1)
    found = occlusion(surface.averaged(step), directions)
    if step == 1:
        return found
    if not np.isfinite(found).any():
        return np.where(surface.known, 1.0, np.nan)
    rows, columns = ((np.arange(size) + 0.5) / step - 0.5 for size in surface.known.shape)
    place = np.meshgrid(rows, columns, indexing="ij")
    between = np.asarray(map_coordinates(found[nearest_known(np.isfinite(found))], place, order=1, mode="nearest"))
    return np.where(surface.known, between, np.nan)


def _open(highest: Array, along: Array, aside: Array) -> Array:
    """The integral of a half plane up to the horizon, or to the plane of the surface where that is nearer."""
    plane = np.arctan2(along, -aside)
    horizon = np.where(highest > BELOW, np.arccos(np.clip(highest, -1.0, 1.0)), np.pi)
    h = np.clip(np.minimum(horizon, plane), 0.0, np.pi)
    return 0.5 * along * np.sin(h) ** 2 + aside * (0.5 * h - 0.25 * np.sin(2.0 * h))
