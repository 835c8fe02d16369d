"""Surfaces of a scene TOML: [[surface]], and where a thing of a scene stands."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.pose import turned_about_axes
from hagoromo.errors import InputError, described
from hagoromo.files.checks import inside
from hagoromo.files.record import Matrix, Record, Vector, about, decode, like, one_of
from hagoromo.image.scene.scene_lights import EmissionRecord, emission_from
from hagoromo.image.scene.scene_textures import (
    BetaTexture,
    BodyTexture,
    BumpTexture,
    GammaTexture,
    NormalTexture,
    beta_texture_from,
    body_texture_from,
    bump_texture_from,
    gamma_texture_from,
    normal_texture_from,
)
from hagoromo.image.scene.surface import RELIEFS, SHAPES, TEXTURES, Surface
from hagoromo.image.scene.surface_texture import SurfaceTexture
from hagoromo.image.scene.tiled_image import texture_files
from hagoromo.light.spectrum import SOURCE, Spectrum
from hagoromo.reflectance.material.material_table import MATERIAL, reflectance_from_table
from hagoromo.transport.path.optics import KINDS

NOWHERE = (0.0, 0.0, 0.0)


class Placement(Record, frozen=True, kw_only=True):
    """Where a thing stands: `position` and `rotation_deg`, or `pose`."""

    position: Annotated[Vector | None, about("shift, world axes [m]")] = None
    rotation_deg: Annotated[Vector | None, about("turns about x, then y, then z [°]")] = None
    pose: Annotated[Matrix | None, about("4 × 4 by rows [m], in place of position and rotation_deg")] = None


class SceneSurface(Placement, frozen=True, kw_only=True):
    """A surface: a shape of unit size, or a mesh."""

    shape: Annotated[
        Annotated[str, one_of(*SHAPES)] | None, about("shape of unit size, before its place and scale")
    ] = None
    mesh: Annotated[str | None, about("mesh file, in place of shape")] = None
    smooth: Annotated[bool, about("whether normals of a mesh are interpolated")] = True
    scale: Annotated[float | Vector, about("factor on the size, one number or one an axis")] = 1.0
    reflectance: Annotated[dict[str, Any], MATERIAL, about("its reflectance")]
    optics: Annotated[
        Annotated[str, one_of(*KINDS[1:])] | None, about("mirror or glass in place of body and facets; mode path only")
    ] = None
    absorption: Annotated[
        Any, SOURCE, about("absorption coefficient of glass [1/m]: a number, a CSV file or a table; default: clear")
    ] = None
    body_texture: Annotated[
        dict[str, Any] | None,
        like(BodyTexture),
        about("body colour from place to place, in place of the reflectance's"),
    ] = None
    beta_texture: Annotated[
        dict[str, Any] | None, like(BetaTexture), about("factor on the reflectance's beta from place to place")
    ] = None
    gamma_texture: Annotated[
        dict[str, Any] | None,
        like(GammaTexture),
        about("half width of the facets from place to place, in place of the reflectance's gamma"),
    ] = None
    normal_texture: Annotated[
        dict[str, Any] | None,
        like(NormalTexture),
        about("normals from place to place, in tangent space"),
    ] = None
    bump_texture: Annotated[
        dict[str, Any] | None, like(BumpTexture), about("heights from place to place, by which normals are turned")
    ] = None
    emission: Annotated[dict[str, Any] | None, like(EmissionRecord), about("light that its front gives off")] = None
    name: Annotated[str, about("name of the surface")] = ""


def surface_from(record: dict[str, Any], folder: Path, where: str, mesh_of: Callable[..., Surface]) -> Surface:
    """The surface of a table [[surface]] of a file in `folder`. mesh_of: reads meshes."""
    key = decode(record, SceneSurface, where)
    if (key.shape is None) == (key.mesh is None):
        raise InputError(f"{where}: give either shape ({', '.join(SHAPES)}) or mesh (a file)")
    scale = key.scale if isinstance(key.scale, tuple) else (key.scale,) * 3
    pose = pose_of(key, where) @ np.diag([*scale, 1.0])
    reflectance = reflectance_from_table(key.reflectance, folder, f"{where} reflectance")
    tables = (getattr(key, name) or {} for name in (*TEXTURES, *RELIEFS))
    with described(where):
        files = texture_files(folder, [str(table["file"]) for table in tables if "file" in table])
    further: dict[str, Any] = {
        "optics": key.optics or "",
        "absorption": None if key.absorption is None else Spectrum.load(key.absorption, folder),
        "beta_texture": beta_texture_from(key.beta_texture, files, where),
        "normal_texture": normal_texture_from(key.normal_texture, files, where),
        "bump_texture": bump_texture_from(key.bump_texture, files, where),
        "emission": emission_from(key.emission, folder, where),
    }
    body = body_texture_from(key.body_texture, files, where)
    gamma = gamma_texture_from(key.gamma_texture, files, where)
    if isinstance(body, SurfaceTexture):
        further["body_texture"] = body
    if isinstance(gamma, SurfaceTexture):
        further["gamma_texture"] = gamma
    given = {"vertex_colours": True} if body is True else {}
    given |= {"vertex_gamma": gamma} if isinstance(gamma, tuple) else {}
    if key.shape is not None:
        if given:
            what = "body_texture" if body is True else "gamma_texture"
            raise InputError(f"{where} {what}: a shape has no vertices: give file (an image), or a mesh")
        return files.placed(Surface(reflectance, key.shape, pose=pose, name=key.name, **further))
    mesh = str(key.mesh)
    made = mesh_of(
        inside(folder, mesh), reflectance, pose=pose, smooth=key.smooth, name=key.name or Path(mesh).stem, **given
    )
    return replace(files.placed(made), **further)


def pose_of(key: Placement, where: str) -> NDArray[np.float64]:
    """(4, 4) of a place, without its scale."""
    if key.pose is not None:
        if key.position is not None or key.rotation_deg is not None:
            raise InputError(f"{where}: pose says all: leave position and rotation_deg out")
        return np.reshape(key.pose, (4, 4))
    pose = np.eye(4)
    pose[:3, :3] = turned_about_axes(key.rotation_deg or NOWHERE)
    pose[:3, 3] = key.position or NOWHERE
    return pose
