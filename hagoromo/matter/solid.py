"""Solid: a signed distance or a closed mesh → density with outward axis (element plane). All in mm."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import arrays, mitsuba
from hagoromo.errors import InputError
from hagoromo.files.door import check_memory
from hagoromo.files.mesh import read_mesh
from hagoromo.matter.fill import Fineness, fill
from hagoromo.matter.shape import Shape, coverage, distance_and_normal
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.volume.plan import BoxPlan

Extent = tuple[tuple[float, ...], tuple[float, ...]]  # low and high corner [mm]
SAMPLES_PER_VOXEL = 8.0  # points on the surface of a mesh in the area of a voxel's face
MOST_SAMPLES = 20_000_000
BOUNDED = 10.0  # voxels, how far distances are told when bricks are sought: more than half the diagonal of an octant
CREASE = np.radians(40)  # edges of a mesh sharper than this stay sharp


def solid(shape: Shape, extent: Extent, material: Reflectance, fineness: Fineness, name: str = "solid") -> BoxPlan:
    """A solid of density 1 within `extent`; its axis is the outward normal of the nearest surface.

    Where it is thinner than two voxels its density is less than 1 there, but not 0.
    """

    def field(point: Any) -> tuple[Any, Any]:
        distance, normal = distance_and_normal(shape, point)
        return coverage(distance, fineness.softness), normal

    return fill(field, lambda point: shape(point) - fineness.softness, extent, fineness, material, name=name)


def mesh_solid(path: str | Path, height_mm: float, material: Reflectance, fineness: Fineness) -> BoxPlan:
    """The closed mesh in a file, as high as `height_mm`, standing on z = 0 around x = y = 0.

    Raises `InputError` for a file that holds no mesh, or one that does not enclose a volume.
    """
    mesh = MeshSurface(path, height_mm, fineness.voxel_mm)
    margin = fineness.softness
    extent = tuple(mesh.low - margin), tuple(mesh.high + margin)

    def field(point: Any) -> tuple[Any, Any]:
        distance, normal = mesh.distance_and_normal(point, margin)
        return coverage(distance, fineness.softness), normal

    def bound(point: Any) -> Any:
        return mesh.distance_and_normal(point, BOUNDED * fineness.voxel_mm)[0] - margin

    return fill(field, bound, extent, fineness, material, name=mesh.name)


class MeshSurface:
    """A closed mesh as points on its surface, so dense that the plane of the nearest one gives the distance."""

    def __init__(self, path: str | Path, height_mm: float, voxel_mm: float) -> None:
        import trimesh
        from scipy.spatial import KDTree

        mesh = _closed_mesh(path)
        self.name = Path(path).stem
        mesh.apply_scale(height_mm / mesh.extents[2])
        mesh.apply_translation([*-mesh.bounds.mean(axis=0)[:2], -mesh.bounds[0, 2]])
        self.low, self.high = mesh.bounds
        count = int(SAMPLES_PER_VOXEL * mesh.area / voxel_mm**2)
        if count > MOST_SAMPLES:
            raise InputError(f"{path}: voxel_mm {voxel_mm:g} is too fine for a mesh of {mesh.area:.3g} mm²")
        check_memory(200 * count, f"{count} points on the surface of {path}")
        points, faces = trimesh.sample.sample_surface(mesh, max(count, 1000), seed=0)[:2]
        self._points, self._planes = np.asarray(points), np.asarray(mesh.face_normals[faces])
        self._normals = _smooth_normals(mesh, self._points, np.asarray(faces))
        self._tree = KDTree(self._points)
        self._scene = _ray_scene(mesh)

    def distance_and_normal(self, point: Any, reach: float) -> tuple[Any, Any]:
        """Signed distance [mm], ± `reach` at most, and unit outward normal of the nearest surface, for points [mm].

        Points that are farther than `reach` carry the normal of any surface.
        """
        kinds = arrays()
        asked = np.array(point, np.float64).T
        far, nearest = self._tree.query(asked, distance_upper_bound=reach, workers=-1)
        found = np.isfinite(far)
        nearest = np.where(found, nearest, 0)
        above = np.einsum("ij,ij->i", asked - self._points[nearest], self._planes[nearest])
        beyond = np.where(np.array(self._inside(point)), -reach, reach)
        distance = np.where(found, np.clip(above, -reach, reach), beyond).astype(np.float32)
        normal = self._normals[nearest].astype(np.float32)
        return kinds.Float(distance), kinds.Array3f(*(np.ascontiguousarray(normal[:, k]) for k in range(3)))

    def _inside(self, point: Any) -> Any:
        """Whether points are inside: the first face that a ray from them meets is met from behind."""
        mi = mitsuba()
        direction = mi.Vector3f(0.36, 0.48, 0.8)
        hit = self._scene.ray_intersect(mi.Ray3f(mi.Point3f(point), direction))
        return hit.is_valid() & (dr.dot(hit.n, direction) > 0)


def _smooth_normals(mesh: Any, points: NDArray[np.float64], faces: NDArray[np.int64]) -> NDArray[np.float64]:
    """Normals of the vertices interpolated at `points` on `faces`; those across a CREASE are left out: (n, 3)."""
    import trimesh

    shares = trimesh.triangles.points_to_barycentric(mesh.triangles[faces], points)
    flat, corners = mesh.face_normals[faces][:, None], mesh.vertex_normals[mesh.faces[faces]]
    corners = np.where((corners * flat).sum(axis=-1, keepdims=True) > np.cos(CREASE), corners, flat)
    normals = (shares[..., None] * corners).sum(axis=1)
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


def _closed_mesh(path: str | Path) -> Any:
    mesh = read_mesh(path)
    if not mesh.is_volume:
        raise InputError(f"{path} does not enclose a volume: close its holes and turn its faces outwards first")
    return mesh


def _ray_scene(mesh: Any) -> Any:
    mi = mitsuba()
    shape = mi.Mesh("mesh", len(mesh.vertices), len(mesh.faces))
    values = mi.traverse(shape)
    values["vertex_positions"] = np.ascontiguousarray(mesh.vertices, np.float32).ravel()
    values["faces"] = np.ascontiguousarray(mesh.faces, np.uint32).ravel()
    values.update()
    return mi.load_dict({"type": "scene", "mesh": shape})
