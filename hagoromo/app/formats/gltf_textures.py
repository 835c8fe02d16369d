"""Textures of glTF 2.0: the base colour of a material as an image or colours of vertices, both ways; roughness out.

A base colour is baseColorFactor · baseColorTexture · COLOR_0; images are sRGB, the others linear. Enters: the JSON of a
file and one of its meshes. Leaves: files in the folder of a scene, and the table `body_texture` that names them; or the
material of a surface's texture.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hagoromo.errors import InputError
from hagoromo.files.gltf import image_bytes
from hagoromo.files.picture import read_picture
from hagoromo.files.png import write_png
from hagoromo.image.surface import Surface
from hagoromo.image.surface_texture import SurfaceTexture
from hagoromo.light.colour import linear_colour, srgb_decode, srgb_encode
from hagoromo.light.environment import upsampled
from hagoromo.light.spectrum import Spectrum

KINDS = {b"\x89PNG": ".png", b"\xff\xd8\xff": ".jpg"}  # first bytes → suffix
NEAREST, REPEAT = 9728, 10497  # a filter and a wrapping of a sampler
OTHER_MAPS = ("metallicRoughnessTexture", "normalTexture", "occlusionTexture", "emissiveTexture")
ROWS_AT_ONCE = 256
Array = NDArray[np.float64]


def body_texture_of(
    path: Path,
    record: Mapping[str, Any],
    material: Mapping[str, Any],
    mesh: Any,
    colours: Array | None,
    folder: Path,
    name: str,
) -> tuple[dict[str, Any] | None, list[str]]:
    """The table `body_texture` of a mesh of a material, None where it has one colour; and what is lost.

    mesh: a `trimesh.Trimesh`, whose colours of vertices become those of the base colour where they are taken. colours:
    of its vertices, see `vertex_colours`. An image is written into `folder` as `name` and its suffix. `InputError` for
    a damaged image, or one outside the folder of the file.
    """
    pbr = material.get("pbrMetallicRoughness") or {}
    factor = np.clip(np.array(pbr.get("baseColorFactor", (1, 1, 1, 1)), float)[:3], 0.0, 1.0)
    lost = [f"{name}: its {key}" for key in OTHER_MAPS if key in pbr or key in material]
    texture = pbr.get("baseColorTexture")
    uv = getattr(mesh.visual, "uv", None)
    if texture is not None and (uv is None or np.shape(uv) != (len(mesh.vertices), 2) or texture.get("texCoord", 0)):
        lost.append(f"{name}: its baseColorTexture, as only one on the first UVs is read")
        texture = None
    if texture is None:
        if colours is None:
            return None, lost
        mesh.visual = _painted(mesh, srgb_encode(colours * factor))
        return {"vertex_colours": True}, lost
    if colours is not None:
        lost.append(f"{name}: the colours of its vertices, by which its texture is multiplied")
    if "KHR_texture_transform" in texture.get("extensions", {}):
        lost.append(f"{name}: the transform of its texture")
    one = record["textures"][texture["index"]]
    sampler = record["samplers"][one["sampler"]] if "sampler" in one else {}
    if {sampler.get("wrapS", REPEAT), sampler.get("wrapT", REPEAT)} != {REPEAT}:
        lost.append(f"{name}: how its texture ends: here it repeats")
    file = _written(image_bytes(path, record, int(one["source"])), factor, folder, name, path)
    return {"file": file} | ({"smooth": False} if sampler.get("magFilter") == NEAREST else {}), lost


def vertex_colours(mesh: Any) -> Array | None:
    """Linear R, G, B (n, 3), 0…1, of the vertices of a mesh as trimesh read it from a glTF (a copy lacks them); None
    where it has none.
    """
    visual = mesh.visual
    colours = visual.vertex_colors if visual.kind == "vertex" else None
    if colours is None and "color" in getattr(visual, "vertex_attributes", {}):
        colours = visual.vertex_attributes["color"]
    if colours is None or np.ndim(colours) != 2 or len(colours) != len(mesh.vertices) or np.shape(colours)[1] < 3:
        return None
    stored = np.asarray(colours)[:, :3]
    whole = stored.dtype.kind == "u"
    return np.clip(np.nan_to_num(stored / np.iinfo(stored.dtype).max if whole else stored.astype(float)), 0.0, 1.0)


def _painted(mesh: Any, colours: NDArray[np.uint8]) -> Any:
    from trimesh.visual import ColorVisuals

    return ColorVisuals(mesh, vertex_colors=colours)


def _written(data: bytes, factor: Array, folder: Path, name: str, path: Path) -> str:
    """Write an image into `folder`, each colour times its factor; returns the name of its file."""
    suffix = next((suffix for start, suffix in KINDS.items() if data.startswith(start)), "")
    if not suffix:
        raise InputError(f"{path}: the image of {name} is neither PNG nor JPEG: give one of them")
    file = folder / f"{name}{suffix}"
    file.write_bytes(data)
    values = read_picture(file)  # refuses what is damaged or too large
    if not (factor < 1.0).any():
        return file.name
    file.unlink()
    values = values[..., None] if values.ndim == 2 else values
    channels = values[..., :3] if values.shape[-1] >= 3 else np.repeat(values[..., :1], 3, axis=2)
    top, coloured = np.iinfo(channels.dtype).max, np.empty(channels.shape, np.uint8)
    for first in range(0, len(channels), ROWS_AT_ONCE):
        rows = slice(first, first + ROWS_AT_ONCE)
        coloured[rows] = srgb_encode(srgb_decode(channels[rows] * (255.0 / top)) * factor)
    write_png(file.with_suffix(".png"), coloured)
    return f"{name}.png"


def textured_visual(surface: Surface, vertices: Array, name: str) -> tuple[Any, list[str]]:
    """The trimesh visual of a surface's body_texture and gamma_texture, None where glTF holds neither; what is lost.

    Colours are those under D65, 8 bits; γ is `roughness_of` it, 8 bits. vertices: those of its triangles.
    """
    from PIL import Image
    from trimesh.visual import ColorVisuals, TextureVisuals
    from trimesh.visual.material import PBRMaterial

    body, gamma = surface.body_texture, surface.gamma_texture if surface.reflectance.beta > 0.0 else None
    images, lost = {}, []
    uv = 0.5 * (vertices[:, :2] + 1.0) if surface.shape == "rectangle" else surface.uv
    linear = None
    if body is not None:
        linear = np.clip(np.pi * surface.reflectance.alpha * (body.values @ _colours_of_channels(body)), 0.0, 1.0)
        if body.of == "image" and uv is None:
            lost.append(f"surface {surface.name!r}: the body_texture of its {surface.shape}")
        elif body.of == "image":
            images["baseColorTexture"] = Image.fromarray(srgb_encode(linear))
    painted = body is not None and body.of == "vertices"
    if gamma is not None and (gamma.of == "vertices" or uv is None or painted):
        lost.append(f"surface {surface.name!r}: its gamma_texture, as it, or its body_texture, is not on UVs")
    elif gamma is not None:
        rough = np.zeros((*gamma.values.shape[:2], 3), np.uint8)
        rough[..., 1] = np.round(255.0 * roughness_of(gamma.values[..., 0]))
        images["metallicRoughnessTexture"] = Image.fromarray(rough)
    if painted and linear is not None:
        return ColorVisuals(vertex_colors=np.round(255.0 * linear).astype(np.uint8)), lost
    return TextureVisuals(uv, PBRMaterial(name=name, metallicFactor=0.0, **images)) if images else None, lost


def roughness_of(gamma: ArrayLike) -> Array:
    """Roughness 0…1 of renderers, √α of the GGX whose slopes are half as dense at tan γ = α √(√2 − 1); γ [rad]."""
    width = np.tan(np.minimum(np.asarray(gamma, np.float64), 1.5)) / math.sqrt(math.sqrt(2.0) - 1.0)
    return np.sqrt(np.minimum(width, 1.0))


def _colours_of_channels(texture: SurfaceTexture) -> Array:
    """Linear R, G, B (k, 3) of each spectrum of a texture under D65; those of R, G, B themselves as they were given."""
    given = [one.record() for one in texture.spectra]
    if given == [upsampled(row).record() for row in np.eye(3)]:
        return np.eye(3)
    return np.stack([linear_colour(one, Spectrum.named("D65")) for one in texture.spectra])


def is_of_squares(texture: SurfaceTexture | None) -> bool:
    """Whether it is an image whose pixels stay squares."""
    return texture is not None and texture.of == "image" and not texture.smooth
