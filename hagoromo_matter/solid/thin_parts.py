"""Thin parts: how thick a mesh is beneath its surface, and how much of it is thinner than two voxels. All in mm."""

from __future__ import annotations

import warnings
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import arrays, column
from hagoromo_matter.solid.mesh_rays import MeshRays

Thin = Literal["thicken", "warn"]
START_DEPTH = 5e-4  # [longest] depth at which a ray into the mesh starts, so that it does not meet the face it is on
THIN = 1.0 - 2.0 * START_DEPTH  # [longest] what is thinner than this counts as thin
SAMPLES = 1 << 15  # places on the surface, besides the middle of every face
WARNED_SHARE = 1e-3  # of the surface: smaller parts are thickened without a warning
LEFT_THIN = 0.1  # share of the thin parts that stay thin at the voxel which the warning names


class ThinParts(NamedTuple):
    """Whether there are any, their share of the surface, and a thickness [mm] that all but LEFT_THIN of them have."""

    some: bool
    share: float
    least_mm: float


def thickness(rays: MeshRays, place: Any, inwards: Any, longest: float, asked: Any = True) -> Any:
    """How much matter lies beneath places of the surface, along unit vectors `inwards`, within `longest`."""
    start = START_DEPTH * longest
    rest = longest - start
    return rays.share_inside(place + inwards * start, inwards, rest, asked) * rest + start


def thin_parts(mesh: Any, rays: MeshRays, longest: float) -> ThinParts:
    """What of a `trimesh.Trimesh` is thinner than `longest`.

    Found by rays from the middle of every face and from SAMPLES places, evenly spread by area.
    """
    import trimesh

    place, face = trimesh.sample.sample_surface(mesh, SAMPLES, seed=0)[:2]
    spread = _thickness_at(mesh, rays, place, face, longest)
    middle = _thickness_at(mesh, rays, mesh.triangles_center, np.arange(len(mesh.faces)), longest)
    thin, thin_faces = (values[values < THIN * longest] for values in (spread, middle))
    if not (len(thin) or len(thin_faces)):
        return ThinParts(False, 0.0, longest)
    least = float(np.quantile(thin if len(thin) else thin_faces, LEFT_THIN))
    return ThinParts(True, len(thin) / len(spread), least)


def warn_of_thin(name: str, voxel_mm: float, parts: ThinParts, thin: Thin) -> None:
    """One line about the thin parts of a mesh, unless they are thickened and less than WARNED_SHARE of its surface."""
    if not parts.some or (thin == "thicken" and parts.share < WARNED_SHARE):
        return
    share = f"{100 * parts.share:.3g} %" if parts.share >= WARNED_SHARE else f"less than {100 * WARNED_SHARE:g} %"
    done = "is thickened to that" if thin == "thicken" else "lets light through"
    warnings.warn(
        f"{name}: {share} of its surface is thinner than two voxels of {voxel_mm:.3g} mm and {done}: "
        f"voxels of {max(0.5 * parts.least_mm, 1e-6):.2g} mm show {1 - LEFT_THIN:.0%} of it as it is",
        stacklevel=2,
    )


def _thickness_at(mesh: Any, rays: MeshRays, place: NDArray, face: NDArray, longest: float) -> NDArray[np.float64]:
    points, inwards = (
        arrays().Array3f(*(column(arrays().Float, part) for part in np.asarray(values.T, np.float32)))
        for values in (place, -mesh.face_normals[face])
    )
    return np.array(thickness(rays, points, inwards, longest), float)
