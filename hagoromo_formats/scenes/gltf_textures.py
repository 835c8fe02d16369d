"""Materials of glTF 2.0 and their textures, both ways: base colour, roughness, KHR_materials_specular and _ior.

A base colour is baseColorFactor · baseColorTexture · COLOR_0; images of it are sRGB, the others linear. Enters: the
JSON of a file and one of its meshes. Leaves: files in the folder of a scene, and the tables that name them; or the
material of a surface.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.files.gltf import image_bytes
from hagoromo.files.mesh import uv_of
from hagoromo.files.png import write_png
from hagoromo.image.scene.surface import Surface
from hagoromo.image.scene.surface_texture import SurfaceTexture
from hagoromo.light.colour import srgb_decode, srgb_encode
from hagoromo_formats.scenes.pbr import PbrMaterial, of_one_size
from hagoromo_formats.scenes.pbr_textures import (
    channel_of,
    gloss_image,
    gloss_of_colours,
    lost_textures,
    picture_of,
    uvs_of,
    written_image,
)
from hagoromo_formats.scenes.relief_normals import relief_normals

NEAREST, REPEAT = 9728, 10497  # a filter and a wrapping of a sampler
OTHER_MAPS = ("occlusionTexture", "emissiveTexture")
SPECULAR, IOR, GLASS = (f"KHR_materials_{name}" for name in ("specular", "ior", "transmission"))
READ = (SPECULAR, IOR, GLASS)
GLASS_FROM = 0.5  # transmission
Array = NDArray[np.float64]


def body_texture_of(
    path: Path,
    record: Mapping[str, Any],
    material: Mapping[str, Any],
    mesh: Any,
    colours: Array | None,
    folder: Path,
    name: str,
) -> tuple[dict[str, Any] | None, Array | None, list[str]]:
    """The table `body_texture` of a mesh of a material and the largest of its colours (3,), None where it has one
    colour; and what is lost.

    mesh: a `trimesh.Trimesh`, whose colours of vertices become those of the base colour where they are taken. colours:
    of its vertices, see `vertex_colours`. An image is written into `folder` as `name` and its suffix. `InputError` for
    a damaged image, or one outside the folder of the file.
    """
    pbr = material.get("pbrMetallicRoughness") or {}
    factor = np.clip(np.array(pbr.get("baseColorFactor", (1, 1, 1, 1)), float)[:3], 0.0, 1.0)
    lost = [f"{name}: its {key}" for key in OTHER_MAPS if key in pbr or key in material]
    texture = pbr.get("baseColorTexture")
    if texture is not None and not _on_uvs(texture, mesh):
        lost.append(f"{name}: its baseColorTexture, as only one on the first UVs is read")
        texture = None
    if texture is None:
        if colours is None:
            return None, None, lost
        mesh.visual = _painted(mesh, srgb_encode(colours * factor))
        return {"vertex_colours": True}, colours.max(axis=0) * factor, lost
    if colours is not None:
        lost.append(f"{name}: the colours of its vertices, by which its texture is multiplied")
    smooth = _sampled(record, texture, name, lost)
    file, largest = written_image(_image_of(path, record, texture), factor, folder, name, path)
    return {"file": file} | ({} if smooth else {"smooth": False}), largest, lost


def normal_texture_of(
    path: Path, record: Mapping[str, Any], material: Mapping[str, Any], mesh: Any, folder: Path, name: str
) -> tuple[dict[str, Any] | None, list[str]]:
    """The table `normal_texture` of a material, None without one, and what is lost; its image is written."""
    texture, lost = material.get("normalTexture"), list[str]()
    if texture is None:
        return None, lost
    if not _on_uvs(texture, mesh):
        return None, [f"{name}: its normalTexture, as only one on the first UVs is read"]
    if texture.get("scale", 1.0) != 1.0:
        lost.append(f"{name}: the scale {texture['scale']:g} of its normalTexture, which is taken as 1")
    smooth = _sampled(record, texture, name, lost)
    picture = picture_of(_image_of(path, record, texture), folder, name, path)
    file = f"{name}_normal.png"
    channels = [np.round(65535.0 * channel_of(picture, k)).astype(np.uint16) for k in range(3)]
    write_png(folder / file, np.stack(channels, axis=-1))
    return {"file": file} | ({} if smooth else {"smooth": False}), lost


def material_of(
    path: Path, record: Mapping[str, Any], material: Mapping[str, Any], mesh: Any, folder: Path, name: str
) -> tuple[PbrMaterial, list[str]]:
    """A material without the texture of its base colour, and what is lost; `InputError` as of `body_texture_of`."""
    pbr, more = material.get("pbrMetallicRoughness") or {}, material.get("extensions") or {}
    specular, clear = more.get(SPECULAR), more.get(GLASS, {}).get("transmissionFactor", 0.0)
    lost = [f"{name}: its {key}" for key in more if key not in READ]
    if any(material.get("emissiveFactor", ())):
        lost.append(f"{name}: its own light")
    if 0.0 < clear < 1.0:
        lost.append(f"{name}: its transmission of {clear:g}; it is {'glass' if clear >= GLASS_FROM else 'opaque'}")
    base = np.array(pbr.get("baseColorFactor", (1, 1, 1, 1)), float)[:3]
    made = PbrMaterial(
        base, float(pbr.get("roughnessFactor", 1.0)), float(pbr.get("metallicFactor", 1.0)) if material else 0.0,
        float(more.get(IOR, {}).get("ior", 1.5)),
    )  # fmt: skip
    if clear >= GLASS_FROM:
        return made._replace(glass=True), lost
    maps: dict[str, Any] = {}
    if specular is not None:
        tint = np.array(specular.get("specularColorFactor", (1, 1, 1)), float)
        coloured = specular.get("specularColorTexture")
        bands = [_channel(path, record, coloured, k, mesh, folder, name, [] if k else lost) for k in range(3)]
        if found := [band for band in bands if band is not None]:
            colours = srgb_decode(255.0 * np.stack([values for values, _ in found], axis=-1).astype(np.float64))
            colour, maps["specular_map"], varied = gloss_of_colours(colours)
            tint, maps["smooth"] = tint * colour, found[0][1]
            if varied:
                lost.append(f"{name}: the colour of its gloss by place, of which the mean stands")
        made = made._replace(specular=float(specular.get("specularFactor", 1.0)), tint=np.clip(tint, 0.0, None))
        if (alpha := _channel(path, record, specular.get("specularTexture"), 3, mesh, folder, name, lost)) is not None:
            factors, others = of_one_size(alpha[0], maps.get("specular_map"))
            maps["specular_map"], maps["smooth"] = factors * others, alpha[1]
    both = pbr.get("metallicRoughnessTexture")
    if (green := _channel(path, record, both, 1, mesh, folder, name, lost)) is not None:
        maps["roughness_map"], maps["smooth"] = green
        metal = _channel(path, record, both, 2, mesh, folder, name, [])
        mean = 0.0 if metal is None else float(metal[0].mean())
        if metal is not None and made.metallic > 0.0 and np.ptp(metal[0]) > 0.0:
            lost.append(f"{name}: its metal by place, of which the mean stands")
        made = made._replace(metallic=made.metallic * mean)
    return made._replace(**maps), lost


def _on_uvs(texture: Mapping[str, Any], mesh: Any) -> bool:
    """Whether a texture lies on the first UVs, and the mesh has them."""
    return uv_of(mesh) is not None and not texture.get("texCoord", 0)


def _sampled(record: Mapping[str, Any], texture: Mapping[str, Any], name: str, lost: list[str]) -> bool:
    """Whether a texture is interpolated; how else it is sampled is lost."""
    if "KHR_texture_transform" in texture.get("extensions", {}):
        lost.append(f"{name}: the transform of its texture")
    one = record["textures"][texture["index"]]
    sampler = record["samplers"][one["sampler"]] if "sampler" in one else {}
    if {sampler.get("wrapS", REPEAT), sampler.get("wrapT", REPEAT)} != {REPEAT}:
        lost.append(f"{name}: how its texture ends: here it repeats")
    return sampler.get("magFilter") != NEAREST


def _image_of(path: Path, record: Mapping[str, Any], texture: Mapping[str, Any]) -> bytes:
    return image_bytes(path, record, int(record["textures"][texture["index"]]["source"]))


def _channel(
    path: Path, record: Mapping[str, Any], texture: Mapping[str, Any] | None, number: int, mesh: Any,
    folder: Path, name: str, lost: list[str],
) -> tuple[NDArray[np.float32], bool] | None:  # fmt: skip
    """A channel (h, w), 0…1, of a texture that is not of colours, and whether it is interpolated; None for none."""
    if texture is None:
        return None
    if not _on_uvs(texture, mesh):
        lost.append(f"{name}: its texture of gloss, as only one on the first UVs is read")
        return None
    smooth = _sampled(record, texture, name, lost)
    data = _image_of(path, record, texture)
    return channel_of(picture_of(data, folder, name, path), number), smooth


def vertex_colours(stored: NDArray[Any] | None) -> Array | None:
    """Linear R, G, B (n, 3), 0…1, of the colours (n, 3 or 4) of vertices as a glTF has them; None for none."""
    if stored is None or stored.shape[1] < 3:
        return None
    values, whole = stored[:, :3], stored.dtype.kind == "u"
    return np.clip(np.nan_to_num(values / np.iinfo(values.dtype).max if whole else values.astype(float)), 0.0, 1.0)


def _painted(mesh: Any, colours: NDArray[np.uint8]) -> Any:
    from trimesh.visual import ColorVisuals

    return ColorVisuals(mesh, vertex_colors=colours)


def textured_visual(
    surface: Surface, look: PbrMaterial, colours: Array | None, triangles: tuple[Array, NDArray[np.int64]], name: str
) -> tuple[Any, list[str]]:
    """The trimesh visual of a surface's look and its colours, see `look_of`, None without textures; what is lost.

    Images have 8 bits. Green of the one of gloss is roughness, its alpha the factor on F.
    triangles: its vertices and faces.
    """
    from PIL import Image
    from trimesh.visual import ColorVisuals, TextureVisuals
    from trimesh.visual.material import PBRMaterial

    images = {}
    if colours is not None and colours.ndim == 3:
        images["baseColorTexture"] = Image.fromarray(srgb_encode(colours))
    if (image := gloss_image(look)) is not None:
        images["metallicRoughnessTexture"] = Image.fromarray(image)
    on_uvs = colours is None or colours.ndim == 3
    uvs = uvs_of(surface, triangles[0])
    relief = relief_normals(surface, *triangles, uvs if on_uvs else None)
    if relief.values is not None:
        images["normalTexture"] = Image.fromarray(np.round(255.0 * relief.values).astype(np.uint8))
    lost = [*lost_textures(surface, look, colours), *relief.lost]
    if colours is not None and colours.ndim == 2:
        return ColorVisuals(vertex_colors=np.round(255.0 * colours).astype(np.uint8)), lost
    made = PBRMaterial(name=name, metallicFactor=0.0, **images)
    return TextureVisuals(uvs, made) if images else None, lost


def extensions_of(look: PbrMaterial, texture: Mapping[str, Any] | None) -> dict[str, Any]:
    """KHR_materials_specular, _ior and _transmission of a look, whose maps lie in `texture`."""
    made: dict[str, Any] = {} if look.metallic else {IOR: {"ior": look.n}}
    if look.glass:
        return made | {GLASS: {"transmissionFactor": 1.0}}
    if look.specular is not None:
        made[SPECULAR] = {"specularFactor": look.specular, "specularColorFactor": look.tint.tolist()}
        if texture is not None and look.specular_map is not None:
            made[SPECULAR]["specularTexture"] = dict(texture)
    return made


def is_of_squares(texture: SurfaceTexture | None) -> bool:
    """Whether it is an image whose pixels stay squares."""
    return texture is not None and texture.of == "image" and not texture.smooth
