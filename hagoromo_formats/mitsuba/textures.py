"""Textures: those of a surface as textures of Mitsuba, and Mitsuba's bitmaps as files of a scene.toml.

Images of ours have their first row at v = 1, bitmaps of Mitsuba at v = 0.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from hagoromo.files.checks import inside
from hagoromo.files.exr import write_exr
from hagoromo.image.picture.any_picture import read_any_picture
from hagoromo.image.scene.surface import Surface
from hagoromo.image.scene.surface_texture import SurfaceTexture
from hagoromo.light.colour import linear_colour
from hagoromo.light.spectrum import Spectrum
from hagoromo_formats.mitsuba.xml_text import Element, plugin

Values = NDArray[np.floating]
Columns = dict[str, NDArray[np.float32]]


def textures_of(surface: Surface, folder: Path, number: int) -> tuple[list[Element], Columns]:
    """The textures of a surface for the plugin `hagoromo`, named as its parameters, and columns of its vertices.

    Images are written into the folder.
    """
    kinds = {
        "body_colour": (surface.body_texture, _colours),
        "beta": (surface.beta_texture, lambda texture: float(surface.reflectance.beta) * texture.values),
        "gamma": (surface.gamma_texture, lambda texture: texture.values),
    }
    elements: list[Element] = []
    columns: Columns = {}
    for key, (texture, values_of) in kinds.items():
        if texture is None:
            continue
        values = np.asarray(values_of(texture), np.float32)
        if texture.of == "vertices":
            scale = max(float(values.max()), 1e-9)
            columns |= {f"{key}_{c}": values[:, k] / scale for k, c in enumerate("rgb"[: values.shape[-1]])}
            name = ElementTree.Element("string", {"name": "name", "value": f"vertex_{key}_color"})
            elements.append(plugin("texture", "mesh_attribute", key, parts=[name], scale=scale))
            continue
        file = f"{key}_{number}.exr"
        write_exr(folder / file, _channels(values[::-1]))
        filtered = "bilinear" if texture.smooth else "nearest"
        elements.append(
            plugin("texture", "bitmap", key, filename=file, raw=values.shape[-1] == 1, filter_type=filtered)
        )
    return elements, columns


def in_relief(bsdf: Element, surface: Surface, folder: Path, number: int) -> Element:
    """The BSDF of a surface within Mitsuba's for its images of normals and of heights, which are written."""
    kinds = {"normal": ("normalmap", surface.normal_texture), "bump": ("bumpmap", surface.bump_texture)}
    for key, (kind, texture) in kinds.items():
        if texture is None:
            continue
        file = f"{key}_{number}.exr"
        write_exr(folder / file, _channels(texture.values[::-1]))
        filtered = "bilinear" if texture.smooth else "nearest"
        name = "normalmap" if key == "normal" else "heights"
        image = plugin("texture", "bitmap", name, filename=file, raw=True, filter_type=filtered)
        bsdf = plugin("bsdf", kind, parts=[image, bsdf], use_shadowing_function=False)
    return bsdf


def is_coloured(texture: SurfaceTexture | None) -> bool:
    """Whether a texture has another colour than greys."""
    return texture is not None and any(np.ptp(spectrum.values) > 0.0 for spectrum in texture.spectra)


def _colours(texture: SurfaceTexture) -> Values:
    """Linear sRGB under D65 at every place, 0…1; of greys one value."""
    if not is_coloured(texture):
        return (texture.values @ np.array([[s.values[0]] for s in texture.spectra], np.float32)).clip(0.0, 1.0)
    daylight = Spectrum.named("D65")
    basis = [np.full(3, s.values[0]) if np.ptp(s.values) == 0.0 else linear_colour(s, daylight)
             for s in texture.spectra]  # fmt: skip
    return (texture.values @ np.array(basis, np.float32)).clip(0.0, 1.0)


def _channels(values: Values) -> dict[str, NDArray[np.float32]]:
    names = "RGB" if values.shape[-1] == 3 else "Y"
    return {name: np.ascontiguousarray(values[..., k], np.float32) for k, name in enumerate(names)}


def ply_of(vertices: Values, faces: NDArray[Any], columns: Mapping[str, Values]) -> bytes:
    """A binary PLY with `columns` of its vertices beside x, y and z, in single precision."""
    every = {**dict(zip("xyz", np.asarray(vertices).T, strict=True)), **columns}
    corners = np.zeros(len(vertices), [(name, "<f4") for name in every])
    for name, column in every.items():
        corners[name] = column
    triangles = np.zeros(len(faces), [("count", "u1"), ("corners", "<i4", 3)])
    triangles["count"], triangles["corners"] = 3, faces
    lines = ["ply", "format binary_little_endian 1.0", f"element vertex {len(corners)}"]
    lines += [f"property float {name}" for name in every]
    lines += [f"element face {len(triangles)}", "property list uchar int vertex_indices", "end_header", ""]
    return "\n".join(lines).encode("ascii") + corners.tobytes() + triangles.tobytes()


def linear_bitmap(part: Mapping[str, Any], home: Path) -> Values:
    """Linear values (height, width, 1 or 3) of a bitmap of Mitsuba; raw: without the curve of a display."""
    picture = read_any_picture(inside(home, str(part.get("filename", ""))))
    return picture.values if part.get("raw") is True else picture.linear


def written_bitmap(values: Values, part: Mapping[str, Any], on_top: bool, path: Path) -> dict[str, Any]:
    """The file of a body_texture with the values of a bitmap, and its table. on_top: its first row is at v = 1."""
    write_exr(path, _channels(values if on_top else values[::-1]))
    return {"file": path.name, **({"smooth": False} if part.get("filter_type") == "nearest" else {})}
