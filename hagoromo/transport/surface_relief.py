"""Surface relief: normals of surfaces turned by an image of normals, or by the slopes of an image of heights.

In the tangent space of the UVs: x along u, y along v, z along the normal of the front before it is turned. Heights
turn it by their gradient on the surface (Mikkelsen 2020, "Surface Gradient–Based Bump Mapping Framework"), to which
that of an image of normals is added.
"""

from __future__ import annotations

import functools
import operator
from collections.abc import Sequence

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import Array3f, Bool, Float, arrays, lookup
from hagoromo.transport.surface_colours import SurfaceHit, TextureOfSurface, TextureTable

LEAST_RISE = 1e-3  # z of an image's normal at least: it does not point below the surface
SEEN = 1e-3  # cosine to the eye at least: what is turned further away is seen edge-on
ROW = 6  # numbers of a triangle: the change of place [m] along u and v


class SurfaceRelief:
    """Images of normals and heights of all surfaces on the device. A plain object: loops do not take its tables."""

    def __init__(
        self,
        normals: Sequence[TextureOfSurface | None],
        slopes: Sequence[TextureOfSurface | None],
        tangents: Sequence[NDArray[np.float32] | None],
    ) -> None:
        """normals: three values a place, (normal + 1) / 2. slopes: two, change of height along u and v [m], v up.

        tangents: (triangles, 6), `tangents_of` each mesh; None of shapes, which know theirs, and of plain surfaces.
        """
        jit = arrays()
        self.normals, self.slopes = (
            TextureTable(each) if any(texture is not None for texture in each) else None for each in (normals, slopes)
        )
        counts = [0 if one is None else len(one) for one in tangents]
        starts = np.where(counts, np.cumsum([0, *counts])[:-1] + 1, 0).astype(np.uint32)  # 0: a shape
        self.starts, self.meshes = lookup(jit.UInt, starts), sum(counts) > 0
        rows = [one for one in tangents if one is not None]
        self.tangents = lookup(jit.Float, np.concatenate(rows).ravel()) if rows else jit.Float(0)
        dr.eval(self.starts, self.tangents)

    def turned(self, hit: SurfaceHit, along_u: Array3f, along_v: Array3f, to_eye: Array3f) -> Array3f:
        """Normals to the eye at hits; `hit` has those before. along_u, along_v: change of place on shapes [m]."""
        jit = arrays()
        front = dr.select(hit.front, hit.normal, -hit.normal)
        along_u, along_v = self._along(hit, along_u, along_v)
        along_u = along_u - front * dr.dot(front, along_u)
        along_v = along_v - front * dr.dot(front, along_v)
        x = along_u * dr.rsqrt(dr.fmax(dr.squared_norm(along_u), 1e-30))
        y = dr.cross(front, x)
        area = dr.dot(y, along_v) * dr.sqrt(dr.squared_norm(along_u))  # below 0 where the UVs are mirrored
        turned, rise = front, jit.Float(1)
        if self.normals is not None:
            stored = [dr.fma(2.0, value, -1.0) for value in self.normals.at(hit)]
            stored[2] = dr.fmax(stored[2], LEAST_RISE)
            scale = dr.rsqrt(stored[0] * stored[0] + stored[1] * stored[1] + stored[2] * stored[2])
            own = (x * stored[0] + y * dr.copysign(stored[1], stored[1] * area) + front * stored[2]) * scale
            there = self.normals.there(hit.surface)
            turned, rise = dr.select(there, own, front), dr.select(there, stored[2] * scale, 1.0)
        if self.slopes is not None:
            here = self.slopes.there(hit.surface) & (area != 0.0)
            up, right = self.slopes.at(hit)[1], self.slopes.at(hit)[0]
            gradient = dr.cross(along_v, front) * right + dr.cross(front, along_u) * up
            turned = dr.select(here, turned - gradient * (rise / dr.select(area == 0.0, 1.0, area)), turned)
        turned = dr.normalize(dr.select(hit.front, turned, -turned))
        seen = dr.dot(turned, to_eye)
        bent = dr.normalize(dr.fma(to_eye, SEEN - seen, turned))
        tables = [table for table in (self.normals, self.slopes) if table is not None]
        mapped = dr.isfinite(hit.distance) & _any([table.there(hit.surface) for table in tables])
        return dr.select(mapped, dr.select(seen < SEEN, bent, turned), hit.normal)

    def _along(self, hit: SurfaceHit, along_u: Array3f, along_v: Array3f) -> tuple[Array3f, Array3f]:
        """Change of place along u and v [m]: of meshes that of the triangle."""
        if not self.meshes:
            return along_u, along_v
        jit = arrays()
        start = dr.gather(jit.UInt, self.starts, hit.surface)
        mesh = start > 0
        row = (dr.select(mesh, start - 1, 0) + hit.triangle) * ROW
        numbers: list[Float] = [dr.gather(jit.Float, self.tangents, row + k, mesh) for k in range(ROW)]
        return (
            dr.select(mesh, jit.Array3f(*numbers[:3]), along_u),
            dr.select(mesh, jit.Array3f(*numbers[3:]), along_v),
        )


def tangents_of(vertices: NDArray, faces: NDArray, uv: NDArray) -> NDArray[np.float32]:
    """(triangles, 6): change of place along u and along v [m]; 0 of triangles without an area on the UVs.

    >>> tangents_of(np.array([[0, 0, 0], [2, 0, 0], [0, 3, 0]]), np.array([[0, 1, 2]]), np.eye(3)[:, 1:]).tolist()
    [[2.0, 0.0, 0.0, 0.0, 3.0, 0.0]]
    """
    place, flat = np.asarray(vertices, float)[faces], np.asarray(uv, float)[faces]
    (first, second), (a, b) = (
        (corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) for corners in (place, flat)
    )
    area = a[:, :1] * b[:, 1:] - a[:, 1:] * b[:, :1]
    inverse = np.divide(1.0, area, out=np.zeros_like(area), where=area != 0.0)
    along_u = (first * b[:, 1:] - second * a[:, 1:]) * inverse
    along_v = (second * a[:, :1] - first * b[:, :1]) * inverse
    return np.concatenate([along_u, along_v], axis=1).astype(np.float32)


def slopes_of(heights: NDArray[np.float32]) -> NDArray[np.float32]:
    """(height, width, 2): change of the heights (height, width) of an image that repeats, along u and v.

    Central differences, of which there are as many as pixels, so that they are interpolated as values are.
    """
    tall, wide = heights.shape
    along_u = (np.roll(heights, -1, 1) - np.roll(heights, 1, 1)) * (0.5 * wide)
    along_v = (np.roll(heights, 1, 0) - np.roll(heights, -1, 0)) * (0.5 * tall)
    return np.stack([along_u, along_v], axis=-1).astype(np.float32)


def _any(several: Sequence[Bool]) -> Bool:
    return functools.reduce(operator.or_, several)
