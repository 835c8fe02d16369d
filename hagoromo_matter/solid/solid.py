"""Solid: a signed distance or a closed mesh → density with outward axis (element plane). All in mm."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from hagoromo.backend import arrays, lookup
from hagoromo.errors import InputError
from hagoromo.files.mesh import read_mesh, read_parts
from hagoromo.matter.fill import CORE_TO, Fineness, fill
from hagoromo.matter.shape import Shape, coverage, distance_and_normal, unit
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.volume.store.plan import BoxPlan
from hagoromo_matter.solid.mesh_rays import MeshRays
from hagoromo_matter.solid.mesh_repair import repaired
from hagoromo_matter.solid.mesh_tree import MeshTree, Nearest
from hagoromo_matter.solid.thin_parts import Thin, ThinParts, thickness, thin_parts, warn_of_thin

Extent = tuple[tuple[float, ...], tuple[float, ...]]  # low and high corner [mm]
BOUNDED = 10.0  # [voxels] reach of distances in the search for bricks: more than half the diagonal of an octant
NEAR_SURFACE = 1e-3  # [half the softness] closer to the surface than this, the normal of the face is used
FARTHEST = 10.0  # [diagonals of the mesh] from the mesh, at which signed distances are still asked for
FLATTEST = 1e-6  # least height of a mesh, of its largest extent
MATERIAL = "material"  # attribute of the faces of a mesh
MOST_SAID = 8  # materials of a mesh that a message lists
CREASE = math.radians(40)  # edges of a mesh sharper than this stay sharp


def solid(shape: Shape, extent: Extent, material: Reflectance, fineness: Fineness, name: str = "solid") -> BoxPlan:
    """A solid of density 1 within `extent`; its axis is the outward normal of the nearest surface.

    Where it is thinner than two voxels its density is less than 1 there, but not 0.
    """

    def field(point: Any) -> tuple[Any, Any]:
        distance, normal = distance_and_normal(shape, point)
        return coverage(distance, fineness.softness), normal

    return fill(field, lambda point: shape(point) - fineness.softness, extent, fineness, material, name=name)


def mesh_solid(
    mesh: MeshSurface,
    material: Reflectance,
    fineness: Fineness,
    thin: Thin = "thicken",
    own: Sequence[Reflectance] = (),
) -> BoxPlan:
    """What a mesh encloses, of density 1; its axis is the outward normal of the nearest surface.

    own: reflectance of the faces of each of the mesh's `named` materials; voxels have that of the nearest face, as deep
    as light comes. The other faces, and what is deeper, have `material`.
    thin: what is thinner than two voxels is made that thick ("thicken"), or it keeps its optical depth, spread over two
    voxels ("warn"). Both sides keep their normals, and a warning says how much of the surface that is. A mesh without
    thin parts is the same with both.
    """
    soft = fineness.softness
    extent = tuple(mesh.low - soft), tuple(mesh.high + soft)
    parts = mesh.thin_parts(soft)
    warn_of_thin(mesh.name, fineness.voxel_mm, parts, thin)
    is_thickened = parts.some and thin == "thicken"
    reach = soft if is_thickened else 0.5 * soft
    matter = mesh.thickened if is_thickened else mesh.matter

    def bound(point: Any) -> Any:
        return mesh.distance(point, BOUNDED * fineness.voxel_mm) - reach

    def field(point: Any) -> tuple[Any, ...]:
        held = matter(point, soft)
        return (*held, mesh.material(point, soft + CORE_TO * fineness.mean_free_path_mm)) if own else held

    plan = fill(field, bound, extent, fineness, material, name=mesh.name)
    return replace(plan, header=replace(plan.header, materials=(material, *own)))


class MeshSurface:
    """The mesh in a file, `height_mm` high, that stands on z = 0 around x = y = 0: its nearest face, what is inside.

    rotation_deg: turns it about x, then y, then z before. named: materials of its faces that `material` numbers, from 1
    on. A warning lists repairs, see `repaired`.
    Raises `InputError` for a file that holds no mesh, one that does not enclose a volume, or has no such materials.
    """

    def __init__(
        self,
        path: str | Path,
        height_mm: float,
        rotation_deg: Sequence[float] = (0.0, 0.0, 0.0),
        named: Sequence[str] = (),
    ) -> None:
        mesh = repaired(_numbered(path, named) if named else read_mesh(path), str(path))
        self.name, self._mesh = Path(path).stem, stood(mesh, height_mm, rotation_deg)
        self.low, self.high = mesh.bounds
        self._diagonal = float(np.linalg.norm(mesh.extents))
        vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
        self._tree, self._rays = MeshTree(vertices, faces), MeshRays(vertices, faces)
        self._normals = lookup(arrays().Float, corner_normals(mesh).astype(np.float32))
        self._planes = lookup(arrays().Float, np.asarray(mesh.face_normals, np.float32))
        self._materials = lookup(arrays().UInt, _material_numbers(mesh)) if named else None

    def matter(self, point: Any, softness: float) -> tuple[Any, Any]:
        """Density at points [mm], and unit outward normal of the nearest surface; arbitrary where no surface is near.

        The density is the share of a line of length `softness` across the nearest surface that is inside: the coverage
        of what is thick, and the thickness of what is thin spread over `softness`.
        """
        half = 0.5 * softness
        near = self._tree.nearest(point, half)
        across = self._across(point, near, half)
        share = self._rays.share_inside(point - across * half, across, softness, near.is_within_reach)
        deep = self._rays.inside(point, ~near.is_within_reach)
        return dr.select(near.is_within_reach, share, dr.select(deep, 1.0, 0.0)), self._normal(near)

    def thickened(self, point: Any, softness: float) -> tuple[Any, Any]:
        """As `matter`, but the surface is moved outwards where less than `softness` of matter lies beneath it.

        By g = (`softness` − thickness) / 2, on both sides: a plate of any thickness has an optical depth of `softness`.
        """
        half = 0.5 * softness
        near = self._tree.nearest(point, softness)
        across, is_inside = self._across(point, near, half), self._rays.inside(point)
        inwards = dr.select(is_inside == (dr.dot(across, point - near.point) > 0), across, -across)
        beneath = thickness(self._rays, near.point, inwards, softness, near.is_within_reach)
        grown = dr.fmax(half - 0.5 * beneath, 0.0)
        away = dr.norm(point - near.point)
        is_close = near.is_within_reach & (away < half)
        share = self._rays.share_inside(point - across * half, across, softness, is_close)
        density = dr.select(is_close, share, dr.select(is_inside, 1.0, 0.0))
        moved = coverage(dr.select(is_inside, -away, away) - grown, softness)
        return dr.select(near.is_within_reach & (grown > 0), dr.fmax(density, moved), density), self._normal(near)

    def material(self, point: Any, reach: float) -> Any:
        """Number of the material of the nearest face no farther than `reach` [mm], UInt; 0 without one."""
        near = self._tree.nearest(point, reach)
        return dr.select(near.is_within_reach, dr.gather(arrays().UInt, self._materials, near.face), 0)

    def thin_parts(self, softness: float) -> ThinParts:
        """What is thinner than `softness` [mm], see `thin_parts`."""
        return thin_parts(self._mesh, self._rays, softness)

    def _across(self, point: Any, near: Nearest, half: float) -> Any:
        """Unit vector across the nearest surface, from it to the point; the face's normal where it is on it."""
        away = point - near.point
        plane = dr.gather(arrays().Array3f, self._planes, near.face)
        return dr.select(dr.squared_norm(away) > (NEAR_SURFACE * half) ** 2, unit(away), plane)

    def signed_distance(self, point: Any) -> Any:
        """A `Shape`: signed distance [mm]; its gradient is the normal of the nearest surface, smooth over the faces."""
        still = type(point)(dr.detach(point))
        near = self._tree.nearest(still, FARTHEST * self._diagonal)
        away = dr.norm(still - near.point)
        away = dr.select(self._rays.inside(still), -away, away)
        return away + dr.dot(point - still, self._normal(near))

    def _normal(self, near: Nearest) -> Any:
        """The normal of the nearest face, interpolated between its corners."""
        jit = arrays()
        corners = (dr.gather(jit.Array3f, self._normals, near.face * 3 + k) for k in range(3))
        return unit(sum((corner * near.shares[k] for k, corner in enumerate(corners)), jit.Array3f(0)))

    def distance(self, point: Any, reach: float) -> Any:
        """Distance [mm] to the mesh, `reach` at most; 0 inside."""
        near = self._tree.nearest(point, reach)
        far = dr.select(near.is_within_reach, dr.norm(point - near.point), reach)
        return dr.select(self._rays.inside(point), 0.0, far)


def _numbered(path: str | Path, named: Sequence[str]) -> Any:
    """The mesh in a file, its faces with the number of their material in `named`, from 1 on, as attribute MATERIAL."""
    import trimesh

    parts = read_parts(path)
    unknown = [name for name in named if name not in parts.names]
    if unknown:
        known = ", ".join(repr(name) for name in parts.names[:MOST_SAID] if name) or "none"
        raise InputError(f"{path} has no faces of material {unknown[0]!r}: its materials are {known}")
    number = np.array([1 + named.index(name) if name in named else 0 for name in parts.names])
    return trimesh.Trimesh(
        parts.vertices, parts.faces, process=False, face_attributes={MATERIAL: number[parts.material]}
    )


def _material_numbers(mesh: Any) -> NDArray[np.uint32]:
    """The attribute MATERIAL of a mesh; faces that closed its holes have that of the nearest one that was there."""
    number, middle = mesh.face_attributes[MATERIAL], mesh.triangles_center
    was_there = number >= 0  # trimesh numbers faces that it adds −1
    nearest = KDTree(middle[was_there]).query(middle[~was_there])[1]
    number[~was_there] = number[was_there][nearest]
    return number.astype(np.uint32)


def stood(mesh: Any, height_mm: float, rotation_deg: Sequence[float]) -> Any:
    """`mesh` itself, turned about x, then y, then z, made `height_mm` high and stood on z = 0 around x = y = 0.

    `InputError` for one without a height.
    """
    turn = np.eye(4)
    turn[:3, :3] = Rotation.from_euler("xyz", rotation_deg, degrees=True).as_matrix()
    mesh.apply_transform(turn)
    if not (np.isfinite(mesh.extents).all() and mesh.extents[2] > FLATTEST * mesh.extents.max()):
        raise InputError(f"the mesh is {mesh.extents.tolist()} wide, deep and high: turn it upright by rotation_deg")
    mesh.apply_scale(height_mm / mesh.extents[2])
    return mesh.apply_translation([*-mesh.bounds.mean(axis=0)[:2], -mesh.bounds[0, 2]])


def corner_normals(mesh: Any) -> NDArray[np.float64]:
    """Normals at the corners of the faces, (m, 3, 3): of the vertices, or of the faces where these meet in a CREASE."""
    flat, corners = mesh.face_normals[:, None], mesh.vertex_normals[mesh.faces]
    return np.where((corners * flat).sum(axis=-1, keepdims=True) > math.cos(CREASE), corners, flat)
