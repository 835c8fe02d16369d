"""Relief normals: the images of normals and of heights of a surface → the one image of normals that glTF and USD have.

Heights turn the normal by their gradient on the surface, as `SurfaceRelief` has it. That needs the lengths of u and v
on the surface, which an image does not hold: where they differ from place to place, the median by area stands.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.image.scene.surface import RELIEFS, Surface
from hagoromo.transport.surface_relief import LEAST_RISE, slopes_of, tangents_of
from hagoromo_formats.scenes.pbr import enlarged

Array = NDArray[np.float64]
SAID = 0.02  # of a gradient: what is off by less is not said
SHARE = 0.95  # of the area, of which it is said how far gradients are off


class ReliefNormals(NamedTuple):
    """values: (h, w, 3), (normal + 1) / 2, green along v; None without a relief on UVs. lost: a line for each loss."""

    values: Array | None
    lost: list[str]


def relief_normals(surface: Surface, vertices: Array, faces: NDArray[np.int64], uv: Array | None) -> ReliefNormals:
    """Those of a surface of these triangles, on their UVs (n, 2), v up."""
    if uv is None or not any(surface.reliefs):
        there = [key for key, one in zip(RELIEFS, surface.reliefs, strict=True) if one is not None]
        return ReliefNormals(None, [f"surface {surface.name!r}: its {key}" for key in there])
    normals, heights = surface.reliefs
    shape = np.max([one.values.shape[:2] for one in surface.reliefs if one is not None], axis=0)
    size = int(shape[0]), int(shape[1])
    turned = np.tile([0.0, 0.0, 1.0], (*size, 1))
    if normals is not None:
        turned = 2.0 * np.stack([enlarged(normals.values[..., k], size) for k in range(3)], axis=-1) - 1.0
        turned[..., 2] = np.maximum(turned[..., 2], LEAST_RISE)
        turned /= np.linalg.norm(turned, axis=-1, keepdims=True)
    lost = list[str]()
    if heights is not None:
        way, off = _gradient_of_slopes(vertices @ surface.pose[:3, :3].T, faces, uv)
        slopes = slopes_of(heights.values[..., 0])
        gradient = np.stack([enlarged(slopes[..., k], size) for k in (0, 1)], axis=-1) @ way.T
        turned[..., :2] -= turned[..., 2:] * gradient
        if off > SAID:
            lost.append(
                f"surface {surface.name!r}: how far its UVs are stretched from place to place, by which slopes of its "
                f"bump_texture are off by up to {off:.0%}"
            )
    return ReliefNormals(0.5 + 0.5 * turned / np.linalg.norm(turned, axis=-1, keepdims=True), lost)


def _gradient_of_slopes(vertices: Array, faces: NDArray[np.int64], uv: Array) -> tuple[Array, float]:
    """(2, 2): changes along u and v → the gradient [1/m] in the tangent space, green along v; the median by area. And
    the largest relative difference from it over SHARE of the area.
    """
    along_u, along_v = np.split(tangents_of(vertices, faces, uv).astype(np.float64), 2, axis=1)
    corners = vertices[faces]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    length = np.linalg.norm(along_u, axis=1)
    sheared = (along_u * along_v).sum(axis=1)
    across = np.linalg.norm(np.cross(along_u, along_v), axis=1)
    known = (length > 0.0) & (across > 0.0) & (areas > 0.0)
    if not known.any():
        return np.zeros((2, 2)), 0.0
    length, sheared, across, areas = (each[known] for each in (length, sheared, across, areas))
    ways = np.zeros((len(areas), 2, 2))
    ways[:, 0, 0], ways[:, 1, 0], ways[:, 1, 1] = 1.0 / length, -sheared / (length * across), length / across
    chosen = np.array([[_median(ways[:, i, j], areas, 0.5) for j in (0, 1)] for i in (0, 1)])
    off = np.linalg.norm(ways - chosen, axis=(1, 2)) / np.linalg.norm(ways, axis=(1, 2))
    return chosen, _median(off, areas, SHARE)


def _median(values: Array, weights: Array, share: float) -> float:
    """The value that a share of the weights does not exceed."""
    order = np.argsort(values)
    before = np.cumsum(weights[order])
    return float(values[order][min(np.searchsorted(before, share * before[-1]), len(values) - 1)])
