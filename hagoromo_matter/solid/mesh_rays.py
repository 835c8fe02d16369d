"""Mesh rays: the inside of a triangle mesh by rays through it, on the device.

The winding number of a mesh around a point is how often a ray from it leaves the mesh minus how often it enters: 1
inside, 0 outside, 2 where two parts overlap.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import arrays, mitsuba, traced_scene

DIRECTIONS = (0.36, 0.48, 0.8), (-0.62, 0.71, -0.33), (0.49, -0.76, -0.43)
RAY_OFFSET = 3e-7  # offset of a ray behind a face [extent of the mesh]: a few units in the last place


class MeshRays:
    """Faces (m, 3) of vertices (n, 3), for intersection with rays."""

    def __init__(self, vertices: NDArray[np.floating], faces: NDArray[np.integer]) -> None:
        mi = mitsuba()
        shape = mi.Mesh("mesh", len(vertices), len(faces))
        values = mi.traverse(shape)
        values["vertex_positions"] = np.ascontiguousarray(vertices, np.float32).ravel()
        values["faces"] = np.ascontiguousarray(faces, np.uint32).ravel()
        values.update()
        self._scene = traced_scene({"mesh": shape})
        self._step = float(RAY_OFFSET * np.abs(vertices).max())

    def winding(self, point: Any, asked: Any = True) -> Any:
        """Winding number around points (Array3f), by a majority of three rays; 0 for points that are not `asked`.

        A single ray may hit two faces where it passes the edge between them. The third ray is traced where two differ.
        """
        Array3f = arrays().Array3f
        a, b = (self._left(point, Array3f(*direction), asked) for direction in DIRECTIONS[:2])
        c = self._left(point, Array3f(*DIRECTIONS[2]), asked & (a != b))
        return dr.select(a == b, a, dr.fmax(dr.fmin(a, b), dr.fmin(dr.fmax(a, b), c)))

    def inside(self, point: Any, asked: Any = True) -> Any:
        """Whether the mesh winds around points (Array3f); False for those that are not `asked`."""
        return self.winding(point, asked) > 0

    def share_inside(self, start: Any, direction: Any, length: float, asked: Any = True) -> Any:
        """Share of the line from `start` along the unit `direction` [of `length`] that is inside."""
        return self._way_inside(start, direction, length, self.winding(start, asked), asked) / length

    @dr.syntax
    def _left(self, point: Any, direction: Any, asked: Any) -> Any:
        """How often a ray leaves the mesh minus how often it enters."""
        jit = arrays()
        count, going = jit.Float(0) + 0.0 * point.x, jit.Bool(asked) & (point.x == point.x)
        while going:
            going, _, leaving, point = self._next(point, direction)
            count += dr.select(going, leaving, 0.0)
        return count

    @dr.syntax
    def _way_inside(self, point: Any, direction: Any, length: float, winding: Any, asked: Any) -> Any:
        """Length of a line that is inside; `winding` of the mesh around its start."""
        jit = arrays()
        left, way = jit.Float(length) + 0.0 * point.x, 0.0 * point.x
        going = jit.Bool(asked) & (left > 0)
        while going:
            hit, distance, leaving, point = self._next(point, direction)
            part = dr.select(hit, dr.fmin(distance, left), left)
            way += dr.select(winding > 0, part, 0.0)
            left -= part
            winding -= leaving
            going = hit & (left > 0)
        return way

    def _next(self, point: Any, direction: Any) -> tuple[Any, Any, Any, Any]:
        """The next face along a ray: whether there is one, the distance behind it, ±1 as it leaves or enters."""
        mi = mitsuba()
        hit = self._scene.ray_intersect(mi.Ray3f(mi.Point3f(point), mi.Vector3f(direction)))
        is_hit = hit.is_valid()
        way = dr.select(is_hit, hit.t, 0.0) + self._step
        return is_hit, way, dr.select(dr.dot(hit.n, direction) > 0, 1.0, -1.0), point + direction * way
