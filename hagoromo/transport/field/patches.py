"""Patches: the triangles of surfaces in which light of higher orders is known, on either side of each.

Enters: meshes near the surfaces, coarse or fine as light needs it. They are asked only where a surface is hit already:
which patch is there is found by a short ray along the normal, so that the mesh need not be the surface itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import drjit as dr
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array

from hagoromo.backend import Array3f, Bool, Float, UInt, arrays, lookup, mitsuba, traced_scene
from hagoromo.errors import InputError
from hagoromo.transport.field.second_order import NUMBERS
from hagoromo.transport.field.sent_light import Numbers

SIDES = 2  # front, by the order of a triangle's corners; back
SMOOTH = 0.75  # cosine between normals of triangles across whose corner light goes on smoothly


@dataclass(frozen=True)
class PatchMesh:
    """vertices: (n, 3) [m], from the scene's origin. faces: (m, 3). apart: from the surface at most [m]."""

    vertices: NDArray[np.float64]
    faces: NDArray[np.intp]
    material: int
    apart: float


@dataclass
class Patch:
    """A place on a patch: its number among all sides, whether there is one, the triangle, and shares of its corners."""

    side: UInt
    there: Bool
    face: UInt
    shares: Array3f


class Patches:
    """Triangles of all surfaces. Side k of triangle f is number k · faces + f."""

    def __init__(self, meshes: Sequence[PatchMesh]) -> None:
        jit, mi = arrays(), mitsuba()
        starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
        self.vertices = np.concatenate([mesh.vertices for mesh in meshes])
        self.faces = np.concatenate([mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)])
        corners = self.vertices[self.faces]
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        size = np.linalg.norm(across, axis=1, keepdims=True)
        self.areas, self.normals, self.centres = 0.5 * size[:, 0], across / size, corners.mean(axis=1)
        self.count = len(self.faces)
        per_face = [len(mesh.faces) for mesh in meshes]
        self.apart = np.repeat([mesh.apart for mesh in meshes], per_face)
        self.material = lookup(jit.UInt, np.repeat([mesh.material for mesh in meshes], per_face).astype(np.uint32))
        self.normal_of = lookup(jit.Float, np.pad(self.normals, ((0, 0), (0, 1))).astype(np.float32))
        self.reach = dr.opaque(jit.Float, float(self.apart.max()))
        shape = mi.Mesh("patches", len(self.vertices), self.count)
        values = mi.traverse(shape)
        values["vertex_positions"] = np.ascontiguousarray(self.vertices, np.float32).ravel()
        values["faces"] = np.ascontiguousarray(self.faces, np.uint32).ravel()
        values.update()
        self.scene = traced_scene({"patches": shape})

    def at(self, point: Array3f, normal: Array3f, active: Bool) -> Patch:
        """The patch at points of surfaces whose unit normal, to the side that is meant, is given.

        Its rays have a kernel of their own: OptiX traces one of Mitsuba's scenes in a kernel, and points of surfaces
        are hits in another one.
        """
        mi, jit = mitsuba(), arrays()
        dr.eval(point, normal, active)
        ray = mi.Ray3f(mi.Point3f(dr.fma(normal, self.reach, point)), mi.Vector3f(-normal))
        ray.maxt = 3.0 * self.reach
        hit = self.scene.ray_intersect_preliminary(ray, active=active)
        there = active & hit.is_valid()
        face = dr.select(there, jit.UInt(hit.prim_index), 0)
        back = dr.dot(self.normal(face), normal) < 0.0
        u, v = jit.Float(hit.prim_uv.x), jit.Float(hit.prim_uv.y)
        shares = dr.select(there, jit.Array3f(1.0 - u - v, u, v), 0.0)
        patch = Patch(face + dr.select(back, jit.UInt(self.count), 0), there, face, shares)
        dr.eval(patch)
        return patch

    def behind(self, patch: Patch) -> Patch:
        """The same places on the other side."""
        back = patch.side >= self.count
        side = dr.select(back, patch.side - self.count, patch.side + self.count)
        return Patch(side, patch.there, patch.face, patch.shares)

    def normal(self, face: UInt) -> Array3f:
        """Unit normal of triangles, to their front."""
        x, y, z, _ = dr.gather(arrays().Array4f, self.normal_of, face)
        return arrays().Array3f(x, y, z)

    def at_corners(self, light: Numbers) -> NDArray[np.float32]:
        """Light at the corners of every side, (sides · faces · 3, numbers), from that of the sides: the mean, by area,
        of the triangles around a corner that look nearly the same way.
        """
        columns = np.stack([np.array(number) for numbers in light for number in numbers], axis=-1)
        matrix, parts = self._corners(), columns.reshape(SIDES, self.count, -1)
        return np.concatenate([matrix @ part for part in parts]).astype(np.float32)

    def _corners(self) -> csr_array:
        """(3 · faces, faces), rows of sum 1."""
        size = np.ptp(self.vertices, axis=0).max()
        places = np.unique(np.round(self.vertices / (1e-6 * size)), axis=0, return_inverse=True)[1].ravel()
        vertex, face = places[self.faces].ravel(), np.repeat(np.arange(self.count), 3)
        at_vertex = csr_array((np.ones(len(face)), (vertex, face)), shape=(int(places.max()) + 1, self.count))
        pairs = coo_array(at_vertex[vertex])
        row, other = pairs.coords
        alike = np.sum(self.normals[face[row]] * self.normals[other], axis=1)
        weight = np.where(alike > SMOOTH, self.areas[other] * alike, 0.0)
        total = np.bincount(row, weight, minlength=3 * self.count)
        return csr_array((weight / total[row], (row, other)), shape=(3 * self.count, self.count))


class CornerLight:
    """Light at the corners of all sides of patches, for look-ups. A plain object: loops do not take its values."""

    def __init__(self, patches: Patches, values: NDArray[np.float32]) -> None:
        """`values`: see `Patches.at_corners`. `InputError` where they are not of all corners of these patches."""
        jit, self.patches, self.channels = arrays(), patches, values.shape[-1] // NUMBERS
        if values.dtype != np.float32 or values.shape != (SIDES * 3 * patches.count, self.channels * NUMBERS):
            raise InputError(f"light of {values.shape} numbers is not that at the corners of {patches.count} patches")
        self.packets = -(-values.shape[1] // 4)
        self.values = lookup(jit.Float, np.pad(values, ((0, 0), (0, 4 * self.packets - values.shape[1]))))
        dr.eval(self.values)

    @property
    def bytes(self) -> int:
        """Memory of the light [byte]."""
        return 4 * dr.width(self.values)

    def at_corners(self) -> NDArray[np.float32]:
        """The values that it was made of."""
        rows = np.array(self.values).reshape(-1, 4 * self.packets)
        return np.ascontiguousarray(rows[:, : self.channels * NUMBERS])

    def at(self, patch: Patch) -> list[list[Float]]:
        """Nine numbers of every channel."""
        jit = arrays()
        total = [jit.Array4f(0.0) for _ in range(self.packets)]
        for corner in range(3):
            start = (patch.side * 3 + corner) * self.packets
            for k in range(self.packets):
                packet = dr.gather(jit.Array4f, self.values, start + k, patch.there)
                total[k] = dr.fma(packet, patch.shares[corner], total[k])
        flat = [total[k // 4][k % 4] for k in range(self.channels * NUMBERS)]
        return [flat[c * NUMBERS : (c + 1) * NUMBERS] for c in range(self.channels)]
