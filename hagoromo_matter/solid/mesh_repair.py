"""Mesh repair: a mesh from a file → one whose faces enclose a volume and face outwards; it reports the repairs."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import arrays
from hagoromo.errors import InputError
from hagoromo_matter.solid.mesh_rays import MeshRays

LEAST_VOLUME = 1e-6  # volume over area^(3/2) (a ball: 0.094) below which a mesh counts as an open sheet
TEST_OFFSET = 1e-3  # offset of the test point from a face [√area of the face]


def repaired(mesh: Any, where: str) -> Any:
    """`mesh` (a `trimesh.Trimesh`), closed and with its faces outwards; a warning lists the repairs.

    Corners in one place are joined, holes closed by fans, faces turned; parts may overlap, cavities stay. Edges that
    stay open, or where more than two faces meet, are left: `MeshRays` finds the inside of such a mesh by a majority.
    where: the file, for messages. Raises `InputError` for a mesh that encloses no volume.
    """
    import trimesh

    said = []
    mesh = mesh.copy()
    mesh.merge_vertices(merge_tex=True, merge_norm=True)
    mesh.update_faces(mesh.nondegenerate_faces() & mesh.unique_faces())
    if not mesh.is_winding_consistent:
        trimesh.repair.fix_winding(mesh)
        said.append("faces turned the same way")
    if not mesh.is_watertight:
        before = len(mesh.faces)
        trimesh.repair.fill_holes(mesh, use_fan=True)
        said += [f"holes filled by {len(mesh.faces) - before} faces"] if len(mesh.faces) > before else []
    said += _turned_outwards(mesh)
    if not (len(mesh.faces) and _volumes(mesh).sum() > LEAST_VOLUME * mesh.area**1.5):
        raise InputError(f"{where} does not enclose a volume: close its holes first")
    if not mesh.is_watertight:
        said.append("edges left open: its inside is what most of three rays say")
    if said:
        warnings.warn(f"{where} does not enclose a volume as it is: {', '.join(said)}", stacklevel=2)
    return mesh


def _turned_outwards(mesh: Any) -> list[str]:
    """Turn a mesh, or parts of it, that are inside out; cavities are kept. Returns what was done."""
    import trimesh

    volumes = _volumes(mesh)
    if volumes.sum() < 0:
        mesh.invert()
        return ["faces turned outwards"]
    part = trimesh.graph.connected_component_labels(mesh.face_adjacency, node_count=len(mesh.faces))
    inwards = np.flatnonzero(np.bincount(part, volumes) < 0)
    inverted = [k for k in inwards if _is_inverted(mesh, np.flatnonzero(part == k))]
    if not inverted:
        return []
    turned = np.isin(part, inverted)
    mesh.faces[turned] = mesh.faces[turned][:, ::-1]
    return [f"{len(inverted)} of its parts turned outwards"]


def _volumes(mesh: Any) -> NDArray[np.float64]:
    """Signed volumes (m,) of the tetrahedra that the faces make with the mesh's middle."""
    a, b, c = (mesh.triangles - mesh.vertices.mean(axis=0)).transpose(1, 0, 2)
    return (a * np.cross(b, c)).sum(axis=1) / 6.0


def _is_inverted(mesh: Any, faces: NDArray[np.integer]) -> bool:
    """Whether a part whose `faces` look inwards is no cavity: what it encloses is in no other part."""
    largest = faces[mesh.area_faces[faces].argmax()]
    place = (
        mesh.triangles_center[largest] + TEST_OFFSET * np.sqrt(mesh.area_faces[largest]) * mesh.face_normals[largest]
    )
    rays = MeshRays(mesh.vertices, mesh.faces)
    return float(rays.winding(arrays().Array3f(*(float(x) for x in place)))[0]) < 0
