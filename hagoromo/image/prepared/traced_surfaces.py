"""Traced surfaces: all surfaces of a scene as Mitsuba holds them, and what rays hit of them.

A surface that moves while the shutter is open stands still in a scene of its own, into which rays are moved by the way
back from where it is at their instant.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from typing import Any, NamedTuple

import drjit as dr
import numpy as np

from hagoromo.backend import Array3f, Bool, Float, UInt, arrays, lookup, mitsuba, opaque_vector, traced_scene
from hagoromo.errors import InputError
from hagoromo.image.scene.surface import Surface
from hagoromo.image.scene.texture_tables import surface_relief
from hagoromo.transport.frames import Poses
from hagoromo.transport.surface_colours import SurfaceHit

MISS_DISTANCE = 1e6  # distance of the point of a ray that hits nothing [m]: finite, and outside all boxes
AXES = "normal", "flat", "ground"  # of hits, turned with what moves
RELATIVE_SHADOW_BIAS = 2e-5  # offset of the origin of shadow rays along the normal, as a share of the surfaces' extent


class Surfaces:
    """All surfaces of a scene as Mitsuba holds them, counted from a place of their own: see `seen_from`.

    instant: of surfaces that move, the number of the poses that rays have (UInt), as of `Frames`; None: as they stand.
    """

    def __init__(
        self, surfaces: Sequence[Surface], origin: np.ndarray, moving: Mapping[int, Poses] | None = None
    ) -> None:
        """`surfaces`: in the world. `origin`: (3,) [m], from which Mitsuba counts. moving: of a `MovingScene`."""
        jit, moving = arrays(), moving or {}
        if moving and dr.backend_v(jit.Float) != dr.JitBackend.LLVM:  # see `traced_scene`
            raise InputError(
                "a surface moves while the shutter is open, which walks on a GPU do not follow: render on the CPU "
                "(HAGOROMO_BACKEND=llvm), or the mean of pictures at several times (--times 16)"
            )
        self.origin, self.offset = origin, opaque_vector(np.zeros(3))
        self.surfaces, self.instant = tuple(surfaces), None
        self.still = _Traced({k: each for k, each in enumerate(surfaces) if k not in moving}, origin)
        self.movers = [_Mover(k, surfaces[k], poses, origin) for k, poses in moving.items()]
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
        place = origin + self.offset
        found = self._hit(self.still, place, direction)
        for mover in self.movers:
            back = mover.way_back(self.instant)
            other = self._hit(mover.traced, back.place(place), back.direction(direction))
            axes = {key: back.turned(value) for key in AXES if (value := getattr(other, key)) is not None}
            other, nearer = other._replace(**axes), other.distance < found.distance
            found = SurfaceHit(*(None if a is None else dr.select(nearer, b, a)
                                 for a, b in zip(found, other, strict=True)))  # fmt: skip
        point = dr.fma(direction, dr.fmin(found.distance, MISS_DISTANCE), origin)
        return found._replace(point=point + found.flat * self.shadow_bias)

    def _hit(self, traced: _Traced, origin: Array3f, direction: Array3f) -> SurfaceHit:
        """First hits within a scene of Mitsuba's; their point is not that of the hit, but the origin."""
        mi, jit = mitsuba(), arrays()
        hit = traced.scene.ray_intersect(mi.Ray3f(mi.Point3f(origin), mi.Vector3f(direction)))
        flat, normal = jit.Array3f(hit.n), jit.Array3f(hit.sh_frame.n)
        back = dr.dot(flat, direction) > 0
        flat, normal = dr.select(back, -flat, flat), dr.select(back, -normal, normal)
        surface = dr.gather(jit.UInt, traced.order, dr.reinterpret_array(jit.UInt, hit.shape))
        uv = jit.Array2f(hit.uv)
        found = SurfaceHit(jit.Float(hit.t), origin, normal, flat, surface, ~back, jit.UInt(hit.prim_index), uv)
        if self.relief is None:
            return found
        turned = self.relief.turned(found, jit.Array3f(hit.dp_du), jit.Array3f(hit.dp_dv), -direction)
        return found._replace(normal=turned, ground=normal)

    def visible(self, point: Array3f, to_lamp: Array3f, distance: Float) -> Bool:
        """Whether no surface stands between points and the lamp."""
        point, length = point + self.offset, dr.fma(distance, 1.0 - 1e-5, -self.shadow_bias)
        seen = ~self.still.between(point, to_lamp, length)
        for mover in self.movers:
            back = mover.way_back(self.instant)
            seen &= ~mover.traced.between(back.place(point), back.direction(to_lamp), length)
        return seen


class _Traced:
    """Surfaces by their numbers as one scene of Mitsuba's, which may be empty. order: its numbers of shapes → ours."""

    def __init__(self, surfaces: Mapping[int, Surface], origin: np.ndarray) -> None:
        mi, jit = mitsuba(), arrays()
        shapes = {number: _shape(surface, origin) for number, surface in surfaces.items()}
        self.scene = traced_scene({f"s{number}": shape for number, shape in shapes.items()})
        # Mitsuba numbers its shapes anew with every scene: numbers read from memory compile no new kernel
        numbers = {int(dr.reinterpret_array(jit.UInt, mi.ShapePtr(one))[0]): k for k, one in shapes.items()}
        order = np.zeros(max(numbers, default=0) + 1, np.uint32)
        order[list(numbers)] = list(numbers.values())
        self.order = lookup(jit.UInt, order)

    def between(self, origin: Array3f, direction: Array3f, length: Float) -> Bool:
        """Whether something stands in the way of rays up to a length [m]."""
        mi = mitsuba()
        ray = mi.Ray3f(mi.Point3f(origin), mi.Vector3f(direction))
        ray.maxt = mi.Float(length)
        return self.scene.ray_test(ray)


class _Mover:
    """A surface that moves, in a scene of its own."""

    def __init__(self, number: int, surface: Surface, poses: Poses, origin: np.ndarray) -> None:
        self.traced = _Traced({number: surface}, origin)
        ways = surface.pose @ np.linalg.inv(poses)  # from where it is to where it stands, in the world
        ways[:, :3, 3] += ways[:, :3, :3] @ origin - origin
        self.rows = lookup(arrays().Float, np.ascontiguousarray(ways[:, :3].transpose(0, 2, 1), np.float32).ravel())

    def way_back(self, instant: UInt | None) -> _Turn:
        """The way of rays at their instants."""
        jit = arrays()
        if instant is None:
            return _Turn([jit.Array3f(*axis) for axis in np.eye(3).tolist()], jit.Array3f(0.0))
        numbers = [dr.gather(jit.Float, self.rows, instant * 12 + k) for k in range(12)]
        *axes, shift = (jit.Array3f(*numbers[k : k + 3]) for k in range(0, 12, 3))
        return _Turn(axes, shift)


class _Turn(NamedTuple):
    """A turn, by what becomes of x, y, z, and a shift [m]."""

    axes: list[Array3f]
    shift: Array3f

    def place(self, point: Array3f) -> Array3f:
        """Where points come to."""
        return self.direction(point) + self.shift

    def direction(self, direction: Array3f) -> Array3f:
        """Where directions point to."""
        x, y, z = self.axes
        return x * direction[0] + y * direction[1] + z * direction[2]

    def turned(self, direction: Array3f) -> Array3f:
        """Back from where directions point to."""
        return arrays().Array3f(*(dr.dot(axis, direction) for axis in self.axes))


def _shape(surface: Surface, origin: np.ndarray) -> Any:
    mi = mitsuba()
    place = surface.pose[:3, 3] - origin
    surface = surface.traced()  # places on it are drawn from the same triangles
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
