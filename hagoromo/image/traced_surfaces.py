"""Traced surfaces: all surfaces of a scene as Mitsuba holds them, and what rays hit of them."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from typing import Any

import drjit as dr
import numpy as np

from hagoromo.backend import Array3f, Bool, Float, UInt, arrays, lookup, mitsuba, opaque_vector, traced_scene
from hagoromo.image.surface import Surface
from hagoromo.image.texture_tables import surface_relief
from hagoromo.transport.surface_colours import SurfaceHit

MISS_DISTANCE = 1e6  # distance of the point of a ray that hits nothing [m]: finite, and outside all boxes
RELATIVE_SHADOW_BIAS = 2e-5  # offset of the origin of shadow rays along the normal, as a share of the surfaces' extent


class Surfaces:
    """All surfaces of a scene as Mitsuba holds them, counted from a place of their own: see `seen_from`."""

    def __init__(self, surfaces: Sequence[Surface], origin: np.ndarray) -> None:
        """`surfaces`: in the world. `origin`: (3,) [m], from which Mitsuba counts."""
        mi, jit = mitsuba(), arrays()
        self.origin, self.offset = origin, opaque_vector(np.zeros(3))
        self.surfaces = tuple(surfaces)
        shapes = [_shape(surface, origin) for surface in surfaces]
        self.scene = traced_scene({f"s{k}": shape for k, shape in enumerate(shapes)})
        # Mitsuba numbers its shapes anew with every scene: numbers read from memory compile no new kernel
        numbers = [int(dr.reinterpret_array(jit.UInt, mi.ShapePtr(shape))[0]) for shape in shapes]
        order = np.zeros(max(numbers) + 1, np.uint32)
        order[numbers] = np.arange(len(shapes))
        self.order = lookup(jit.UInt, order)
        self.relief = surface_relief(self.surfaces)
        corners = np.concatenate([surface.corners() for surface in surfaces])
        self.shadow_bias = dr.opaque(jit.Float, RELATIVE_SHADOW_BIAS * float(np.linalg.norm(np.ptp(corners, axis=0))))

    def seen_from(self, origin: np.ndarray) -> Surfaces:
        """The same surfaces for rays whose places count from `origin` (3,) [m], world."""
        other = copy(self)
        other.offset = opaque_vector(origin - self.origin)
        return other

    def intersect(self, origin: Array3f, direction: Array3f) -> tuple[Float, Array3f, Array3f, UInt]:
        """First hit: distance [m] (inf: none), offset point, unit normal to the eye, surface number."""
        hit = self.hit(origin, direction)
        return hit.distance, hit.point, hit.normal, hit.surface

    def hit(self, origin: Array3f, direction: Array3f) -> SurfaceHit:
        """First hit of rays."""
        mi, jit = mitsuba(), arrays()
        hit = self.scene.ray_intersect(mi.Ray3f(mi.Point3f(origin + self.offset), mi.Vector3f(direction)))
        flat, normal = jit.Array3f(hit.n), jit.Array3f(hit.sh_frame.n)
        back = dr.dot(flat, direction) > 0
        flat, normal = dr.select(back, -flat, flat), dr.select(back, -normal, normal)
        surface = dr.gather(jit.UInt, self.order, dr.reinterpret_array(jit.UInt, hit.shape))
        point = dr.fma(direction, dr.fmin(hit.t, MISS_DISTANCE), origin) + flat * self.shadow_bias
        uv = jit.Array2f(hit.uv)
        found = SurfaceHit(jit.Float(hit.t), point, normal, flat, surface, ~back, jit.UInt(hit.prim_index), uv)
        if self.relief is None:
            return found
        turned = self.relief.turned(found, jit.Array3f(hit.dp_du), jit.Array3f(hit.dp_dv), -direction)
        return found._replace(normal=turned, ground=normal)

    def visible(self, point: Array3f, to_lamp: Array3f, distance: Float) -> Bool:
        """Whether no surface stands between points and the lamp."""
        mi = mitsuba()
        ray = mi.Ray3f(mi.Point3f(point + self.offset), mi.Vector3f(to_lamp))
        ray.maxt = dr.fma(mi.Float(distance), 1.0 - 1e-5, -self.shadow_bias)
        return ~self.scene.ray_test(ray)


def _shape(surface: Surface, origin: np.ndarray) -> Any:
    mi = mitsuba()
    place = surface.pose[:3, 3] - origin
    surface = surface.without_emission()  # places on it are drawn from the same triangles
    if surface.shape != "mesh":
        pose = np.vstack([np.column_stack([surface.pose[:3, :3], place]), surface.pose[3]])
        return mi.load_dict({"type": surface.shape, "to_world": mi.ScalarTransform4f(pose.tolist())})
    assert surface.vertices is not None and surface.faces is not None
    placed = surface.vertices @ surface.pose[:3, :3].T + place  # in double precision
    mesh = mi.Mesh(surface.name or "mesh", len(placed), len(surface.faces), has_vertex_normals=surface.smooth)
    values = mi.traverse(mesh)
    values["vertex_positions"] = np.ascontiguousarray(placed, np.float32).ravel()
    values["faces"] = np.ascontiguousarray(surface.faces, np.uint32).ravel()
    if surface.smooth:
        import trimesh

        normals = trimesh.Trimesh(placed, surface.faces, process=False).vertex_normals
        values["vertex_normals"] = np.ascontiguousarray(normals, np.float32).ravel()
    values.update()
    return mesh
