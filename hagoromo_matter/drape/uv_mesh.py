"""UV mesh: a mesh on which cloth is laid by its UV map: where its faces lie on the cloth, stretch, seams. All in mm."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.mesh import MeshParts, read_parts
from hagoromo_matter.solid.solid import stood

LOG = logging.getLogger(f"hagoromo.{__name__}")
SAME = 1e-6  # [extent of the map] corners of two faces that are closer on the map are one
MATCHED = 0.05  # [periods of the cloth] by which its pattern may jump where it counts as going on
ISLAND_OFFSET = 1000.0  # periods between the places of one island of the map on the cloth and those of the next
FLAT = 1e-9  # [mean area of a face on the map] smaller ones are no place on the cloth
SHOWN = 0.99  # share of the surface whose stretch is said
WORTH_A_WARNING = 0.01  # stretch


@dataclass(frozen=True, eq=False)
class UvMesh:
    """mesh: a `trimesh.Trimesh`, one vertex at each place; its corners (m, 3, 2) on the cloth [mm]: u × v is outwards.

    uv_mm: length of a unit of the map along u and v. island: of the map, by face; islands are moved by whole periods of
    the cloth, so that none is beside another on it. seams_mm: length of the edges where the pattern does not go on.
    """

    mesh: Any
    corners: NDArray[np.float64]
    uv_mm: tuple[float, float]
    island: NDArray[np.int64]
    seams_mm: float

    def stretch(self) -> tuple[float, float]:
        """Least and greatest length on the surface of 1 mm of cloth, over SHOWN of the area."""
        sides = np.diff(self.corners, axis=1)  # (m, 2, 2)
        known = self.is_on_cloth()
        edges = np.diff(self.mesh.triangles, axis=1)[known]
        slopes = np.linalg.solve(sides[known], edges)  # ∂place/∂u, ∂place/∂v
        size = np.asarray(np.linalg.svd(slopes, compute_uv=False), float)
        area = self.mesh.area_faces[known]
        return _quantile(size[:, 1], area, 1.0 - SHOWN), _quantile(size[:, 0], area, SHOWN)

    def is_on_cloth(self) -> NDArray[np.bool_]:
        """Faces (m,) that have an area on the map."""
        area = np.abs(_areas(self.corners))
        return area > FLAT * area.mean()

    def tangents(self) -> NDArray[np.float64]:
        """Unit direction of u (m, 3) on each face, halfway to that at right angles with v; any where it has none."""
        edges, sides = np.diff(self.mesh.triangles, axis=1), np.diff(self.corners, axis=1)
        sides = np.where(self.is_on_cloth()[:, None, None], sides, np.eye(2))
        slopes = np.asarray(np.linalg.solve(sides, edges), float)  # (m, 2, 3)
        along, beside = slopes[:, 0], slopes[:, 1]
        return _unit(_unit(along) + np.asarray(np.cross(_unit(beside), self.mesh.face_normals), float))

    def say(self, name: str) -> None:
        """One line about scale, stretch and seams: a warning where there are any."""
        least, most = self.stretch()
        seams = f", with {self.seams_mm:.3g} mm of seams where its pattern does not go on" if self.seams_mm else ""
        line = (
            f"{name}: cloth of {self.uv_mm[0]:.4g} × {self.uv_mm[1]:.4g} mm per unit of the UV map, stretched by up to "
            f"{100 * max(most - 1, 0):.2g} % and shrunk by up to {100 * max(1 - least, 0):.2g} %{seams}"
        )
        if seams or max(most - 1, 1 - least) > WORTH_A_WARNING:
            warnings.warn(line, stacklevel=2)
        else:
            LOG.info(line)


def uv_mesh(
    path: str | Path,
    height_mm: float,
    rotation_deg: Sequence[float],
    uv_mm: tuple[float, float] | None,
    period_mm: tuple[float, float],
) -> UvMesh:
    """The mesh in a file, stood as solids are, with its UV map on a cloth that repeats every `period_mm`.

    uv_mm: None: as much as makes the areas on the cloth and on the mesh equal. Where the map is a mirror image, u is
    reversed: the cloth's upper side is outside everywhere. `InputError` for a mesh without a map.
    """
    parts = read_parts(path)
    if parts.uv is None:
        raise InputError(f"{path} has no UV map for the cloth: unwrap the mesh, and save it as OBJ, glTF or PLY")
    mesh, corners = _joined(parts)
    mesh = stood(mesh, height_mm, rotation_deg)
    area = np.abs(_areas(corners)).sum()
    if not (np.isfinite(area) and area > 0):
        raise InputError(f"the UV map of {path} has no area: unwrap the mesh first")
    least = float(np.sqrt(mesh.area / area))
    scale = (least, least) if uv_mm is None else uv_mm
    corners = corners * scale
    corners[_areas(corners) < 0, :, 0] *= -1.0
    island, seams = _islands(mesh, corners, period_mm)
    corners = corners + island[:, None, None] * (ISLAND_OFFSET * np.array(period_mm))
    return UvMesh(mesh, corners, scale, island, seams)


def _joined(parts: MeshParts) -> tuple[Any, NDArray[np.float64]]:
    """The mesh with one vertex at each place, without faces that have no area, and the map of its corners (m, 3, 2)."""
    import trimesh

    assert parts.uv is not None
    places, number = np.unique(parts.vertices, axis=0, return_inverse=True)
    mesh = trimesh.Trimesh(places, number.ravel()[parts.faces], process=False)
    kept = mesh.nondegenerate_faces()
    mesh.update_faces(kept)
    mesh.remove_unreferenced_vertices()
    if not len(mesh.faces):
        raise InputError("the mesh under a cloth has no face with an area")
    return mesh, parts.uv[parts.faces][kept]


def _islands(mesh: Any, corners: NDArray[np.float64], period: tuple[float, float]) -> tuple[NDArray[np.int64], float]:
    """Number of the island of the map of each face, and length of the edges at which the pattern does not go on."""
    import trimesh

    pairs, ends = mesh.face_adjacency, mesh.face_adjacency_edges
    if not len(pairs):
        return np.arange(len(mesh.faces)), 0.0
    jump = np.stack([_at(mesh, corners, pairs[:, 0], end) - _at(mesh, corners, pairs[:, 1], end) for end in ends.T], 1)
    is_seam = np.abs(jump).max(axis=(1, 2)) > SAME * np.ptp(corners, axis=(0, 1)).max()
    turns = jump / period
    goes_on = (np.abs(turns - np.round(turns)).max(axis=(1, 2)) < MATCHED) & (
        np.abs(turns[:, 0] - turns[:, 1]).max(axis=1) < MATCHED
    )
    length = np.linalg.norm(np.diff(mesh.vertices[ends], axis=1)[:, 0], axis=1)
    island = trimesh.graph.connected_component_labels(pairs[~is_seam], node_count=len(mesh.faces))
    return np.asarray(island, np.int64), float(length[is_seam & ~goes_on].sum())


def _at(mesh: Any, corners: NDArray[np.float64], face: NDArray, vertex: NDArray) -> NDArray[np.float64]:
    """The map (k, 2) at a `vertex` (k,) of a `face` (k,)."""
    return corners[face, (mesh.faces[face] == vertex[:, None]).argmax(axis=1)]


def _areas(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Signed areas of triangles (m, 3, 2)."""
    one, other = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return 0.5 * (one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0])


def _quantile(values: NDArray[np.float64], weights: NDArray[np.float64], share: float) -> float:
    order = np.argsort(values)
    summed = np.cumsum(weights[order])
    return float(values[order[min(np.searchsorted(summed, share * summed[-1]), len(order) - 1)]])


def _unit(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(vector / np.maximum(np.linalg.norm(vector, axis=-1, keepdims=True), 1e-12), np.float64)
