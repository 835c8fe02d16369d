"""Mesh chart: coordinates u, v, height and frame of a point over the nearest face of a UV mesh. Lengths in mm."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import arrays, clip, lookup
from hagoromo.matter.shape import Shape, unit
from hagoromo_matter.drape.sheet_chart import FAR_MM, Extent
from hagoromo_matter.drape.uv_mesh import UvMesh
from hagoromo_matter.solid.mesh_tree import MeshTree
from hagoromo_matter.solid.solid import CREASE, corner_normals
from hagoromo_matter.texel.shell import Chart

AT_EDGE = 1e-4  # share of a corner below which a foot is on an edge of its face
AT_HEM = 1e-3  # [mm] from a hem, within which a foot is on it


def mesh_chart(cloth: UvMesh, reach_mm: float, edge_mm: float) -> tuple[Callable[[Any], Chart], Shape, Extent]:
    """Chart of the nearest face, bound of the distance to the mesh, and corners of all within `reach_mm` of it.

    Presence falls to 0 across the hems of an open mesh, over edge_mm. Normals and tangents are smooth over the faces
    but at creases, as of `MeshSurface`.
    """
    tables = _Tables(cloth)

    def chart(point: Any) -> Chart:
        return tables.place(point, reach_mm, edge_mm)

    def bound(point: Any) -> Any:
        near = tables.tree.nearest(point, reach_mm + FAR_MM)
        return dr.select(near.is_within_reach, dr.norm(point - near.point), reach_mm + FAR_MM)

    low, high = cloth.mesh.bounds[0] - reach_mm, cloth.mesh.bounds[1] + reach_mm
    return chart, bound, (tuple(low.tolist()), tuple(high.tolist()))


class _Tables:
    """The corners of a UV mesh on the device."""

    def __init__(self, cloth: UvMesh) -> None:
        mesh, Float = cloth.mesh, arrays().Float
        self.tree = MeshTree(mesh.vertices, mesh.faces)
        self.planes = lookup(Float, mesh.face_normals.astype(np.float32))
        self.smooth = lookup(Float, mesh.vertex_normals[mesh.faces].astype(np.float32))
        self.normals = lookup(Float, corner_normals(mesh).astype(np.float32))
        self.along = lookup(Float, _corner_tangents(cloth).astype(np.float32))
        self.uv = lookup(Float, cloth.corners.astype(np.float32))
        edges = mesh.edges_sorted[_only_once(mesh.edges_sorted)]
        self.hems = MeshTree(mesh.vertices, edges[:, [0, 1, 1]]) if len(edges) else None

    def place(self, point: Any, reach: float, edge: float) -> Chart:
        jit = arrays()
        near = self.tree.nearest(point, reach)
        normal, along = (unit(self._between(jit.Array3f, table, near)) for table in (self.normals, self.along))
        uv = self._between(jit.Array2f, self.uv, near)
        away = point - near.point
        aside = away - normal * dr.dot(away, normal)
        inside, at_hem = self._from_hem(near.point, edge)
        height = dr.select(at_hem, dr.dot(away, normal), self._signed(away, near))
        beyond = dr.select(at_hem, aside, jit.Array3f(0))
        presence = clip(0.5 + (inside - dr.norm(beyond)) * (1.0 / edge), 0.0, 1.0)
        return Chart(
            dr.select(near.is_within_reach, height, reach),
            normal,
            uv.x + dr.dot(beyond, along),
            uv.y + dr.dot(beyond, dr.cross(normal, along)),
            along,
            dr.select(near.is_within_reach, presence, 0.0),
        )

    def _between(self, kind: Any, table: Any, near: Any) -> Any:
        """A table of corners at a place on a face."""
        return sum((dr.gather(kind, table, near.face * 3 + k) * near.shares[k] for k in range(3)), kind(0))

    def _signed(self, away: Any, near: Any) -> Any:
        """Distance of a point `away` from the nearest face, negative beneath it."""
        on_face = dr.fmin(dr.fmin(near.shares[0], near.shares[1]), near.shares[2]) > AT_EDGE
        plane = dr.gather(arrays().Array3f, self.planes, near.face)
        outwards = dr.select(on_face, plane, self._between(arrays().Array3f, self.smooth, near))
        return dr.select(dr.dot(away, outwards) < 0, -1.0, 1.0) * dr.norm(away)

    def _from_hem(self, place: Any, edge: float) -> tuple[Any, Any]:
        """Distance of places on the mesh from its hems, `edge` at most, and whether they are on one."""
        if self.hems is None:
            return edge + 0.0 * place.x, arrays().Bool(False)
        near = self.hems.nearest(place, edge)
        away = dr.select(near.is_within_reach, dr.norm(place - near.point), edge)
        return away, away < AT_HEM


def _corner_tangents(cloth: UvMesh) -> NDArray[np.float64]:
    """Directions of u at the corners (m, 3, 3): mean of an island's faces by angle, or the face's own at a crease."""
    mesh, own = cloth.mesh, cloth.tangents()
    places = (cloth.island[:, None] * len(mesh.vertices) + mesh.faces).ravel()
    _, number = np.unique(places, return_inverse=True)
    total = np.zeros((number.max() + 1, 3))
    np.add.at(total, number.ravel(), (own[:, None] * mesh.face_angles[..., None]).reshape(-1, 3))
    mean = total[number.ravel()].reshape(-1, 3, 3)
    mean /= np.maximum(np.linalg.norm(mean, axis=2, keepdims=True), 1e-12)
    return np.where((mean * own[:, None]).sum(axis=2, keepdims=True) > math.cos(CREASE), mean, own[:, None])


def _only_once(edges: NDArray[np.integer]) -> NDArray[np.intp]:
    """Rows of sorted edges that no other row repeats."""
    _, first, count = np.unique(edges, axis=0, return_index=True, return_counts=True)
    return first[count == 1]
