"""The surface as a textured mesh: a triangle pair per pixel square, texture coordinates, GLB and PLY."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.reflectance.material.material_estimate import MaterialEstimate
from hagoromo_formats.scenes.pbr import roughness_of
from hagoromo_page.publication.lit import rays_to_eye, three_channels
from hagoromo_page.publication.surface_maps import SurfaceMaps

STEEPEST = 10.0  # times the median step of depth of a pixel: squares that step further are left open
Array = NDArray[Any]


def points(maps: SurfaceMaps) -> Array:
    """(h, w, 3) [m] in the page's axes, the camera at 0; `InputError` without depth."""
    if maps.depth is None:
        raise InputError("the measurement has no points, so there is no mesh: measure with --distance, or with a shape")
    return -rays_to_eye(maps) * maps.depth[..., None]


def triangles(maps: SurfaceMaps) -> tuple[Array, Array]:
    """`points`, and the faces (n, 3) between them, indices of known pixels; `InputError` where there is none."""
    place, known = points(maps), maps.known
    faces = _faces(np.where(known, np.cumsum(known).reshape(known.shape) - 1, -1), place)
    if not len(faces):
        raise InputError("the measured surface has no two neighbouring pixels: there is no mesh to export")
    return place, faces


def write_mesh(paths: dict[str, Path], maps: SurfaceMaps, albedo: Array) -> None:
    """Write `paths` ("glb", "ply") of the surface. albedo: (h, w, 3) display values 0…1, the texture."""
    import trimesh
    from PIL import Image
    from trimesh.visual import TextureVisuals
    from trimesh.visual.material import PBRMaterial

    place, faces = triangles(maps)
    known = maps.known
    height, width = known.shape
    rows, columns = np.nonzero(known)
    texture = np.rint(255.0 * np.clip(albedo, 0.0, 1.0)).astype(np.uint8)
    coordinates = np.stack([(columns + 0.5) / width, 1.0 - (rows + 0.5) / height], axis=1)
    shared = {"vertices": place[known], "faces": faces, "vertex_normals": maps.normals[known], "process": False}
    if "glb" in paths:
        material = PBRMaterial(
            baseColorTexture=Image.fromarray(texture), metallicFactor=0.0, roughnessFactor=roughness(maps.materials[0])
        )
        mesh = trimesh.Trimesh(**shared, visual=TextureVisuals(uv=coordinates, material=material))
        paths["glb"].write_bytes(_data(mesh.export(file_type="glb")))
    if "ply" in paths:
        mesh = trimesh.Trimesh(**shared, vertex_colors=texture[known])
        paths["ply"].write_bytes(_data(mesh.export(file_type="ply", vertex_normal=True)))


def roughness(material: MaterialEstimate) -> float:
    """Roughness of GGX renderers, √α with the α whose facets are half as dense at γ; 1 without an interface.

    D(γ)/D(0) = 1/2 of GGX over slopes gives α = tan γ / √(√2 − 1). Walter et al. 2007, "Microfacet models for
    refraction through rough surfaces".
    """
    if material.beta <= 0.0:
        return 1.0
    return float(np.clip(roughness_of(material.gamma), 0.02, 1.0))


def albedo_map(maps: SurfaceMaps) -> Array:
    """(h, w, 3) linear reflectance π α c_b of the body."""
    return np.where(maps.known[..., None], np.pi * three_channels(maps.body), 0.0)


def _data(exported: Any) -> bytes:
    return bytes(exported)


def _faces(number: Array, place: Array) -> Array:
    """(triangles, 3): two per square of four known pixels that depth does not tear apart, seen anticlockwise."""
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:]
    whole = (a >= 0) & (b >= 0) & (c >= 0) & (d >= 0)
    corners = np.stack([place[:-1, :-1, 2], place[:-1, 1:, 2], place[1:, :-1, 2], place[1:, 1:, 2]])
    step = np.ptp(corners, axis=0)
    if whole.any():
        whole &= step <= STEEPEST * max(float(np.median(step[whole])), 1e-9 * float(np.abs(place[..., 2]).max()))
    return np.concatenate([np.stack([a, c, b], axis=2)[whole], np.stack([b, c, d], axis=2)[whole]])
