"""Materials of Blender as those of glTF, which Hagoromo reads: Principled, Diffuse, Glossy and Glass."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np

from .command import Refused

GREY: dict[str, Any] = {
    "pbrMetallicRoughness": {"baseColorFactor": [0.8, 0.8, 0.8, 1.0], "metallicFactor": 0.0, "roughnessFactor": 1.0}
}
KINDS = {"BSDF_PRINCIPLED": "Base Color", "BSDF_DIFFUSE": "Color", "BSDF_GLOSSY": "Color", "BSDF_GLASS": "Color"}


def pixels_of(image: bpy.types.Image) -> np.ndarray:
    """(height, width, 3) numbers of an image, from above, as it has them; `Refused` where they are gone."""
    width, height = image.size
    values = np.empty(width * height * image.channels, np.float32)
    if not len(values) or len(image.pixels) != len(values):
        raise Refused(f"the image {image.name} has no pixels: its file {image.filepath or '(none)'} is missing")
    image.pixels.foreach_get(values)
    values = values.reshape(height, width, image.channels)[::-1]
    return np.ascontiguousarray(values[..., :3] if image.channels > 2 else np.repeat(values[..., :1], 3, axis=2))


def write_image(path: Path, values: np.ndarray) -> None:
    """Numbers (height, width, 3) as EXR, or as PNG of 8 bits, without any conversion.

    By OpenImageIO, which comes with Blender: Blender's own images are encoded as they are saved.
    """
    import OpenImageIO as oiio

    kind = oiio.FLOAT if path.suffix == ".exr" else oiio.UINT8
    held = oiio.ImageBuf(oiio.ImageSpec(values.shape[1], values.shape[0], 3, kind))
    held.set_pixels(oiio.ROI(), np.ascontiguousarray(values, np.float32))
    if not held.write(str(path)):
        raise Refused(f"{path.name} cannot be written: {held.geterror()}")


class Images:
    """Images that materials take, written into the folder of a glTF."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.files = folder, dict[str, int]()
        self.names: list[str] = []

    def number(self, image: bpy.types.Image) -> int:
        """Number of the image's file, which is written the first time."""
        if image.name not in self.files:
            name = f"image_{len(self.names)}.png"
            values = pixels_of(image)
            write_image(self.folder / name, _encoded(values) if image.is_float else values)
            self.files[image.name] = len(self.names)
            self.names.append(name)
        return self.files[image.name]

    def named(self, name: str, values: np.ndarray) -> int:
        """Number of a file of these numbers, which is written the first time."""
        if name not in self.files:
            write_image(self.folder / name, values)
            self.files[name] = len(self.names)
            self.names.append(name)
        return self.files[name]


def look_of(material: bpy.types.Material | None, images: Images, lost: set[str]) -> dict[str, Any]:
    """A material of glTF. lost: gets a line for what it does not hold."""
    if material is None:
        return GREY
    node = _surface(material)
    if node is None:
        lost.add(f"material {material.name}: no Principled, Diffuse, Glossy or Glass BSDF at its output: it is grey")
        return {"name": material.name, **GREY}
    base, texture = _colour(node.inputs[KINDS[node.type]], material, images, lost)
    roughness = 1.0 if node.type == "BSDF_DIFFUSE" else _number(node, "Roughness", material, lost)
    metallic, glass = float(node.type == "BSDF_GLOSSY"), float(node.type == "BSDF_GLASS")
    made: dict[str, Any] = {"name": material.name, "extensions": {}}
    if node.type == "BSDF_PRINCIPLED":
        metallic, glass = (_number(node, name, material, lost) for name in ("Metallic", "Transmission Weight"))
        level = _number(node, "Specular IOR Level", material, lost)
        made["extensions"]["KHR_materials_specular"] = {"specularFactor": min(2.0 * level, 1.0)}
    if node.type in ("BSDF_PRINCIPLED", "BSDF_GLASS"):
        made["extensions"]["KHR_materials_ior"] = {"ior": _number(node, "IOR", material, lost)}
    if glass > 0.0:
        made["extensions"]["KHR_materials_transmission"] = {"transmissionFactor": glass}
    made["pbrMetallicRoughness"] = {
        "baseColorFactor": [*base, 1.0], "metallicFactor": metallic, "roughnessFactor": roughness
    }  # fmt: skip
    if texture is not None:
        made["pbrMetallicRoughness"] |= {"baseColorTexture": {"index": texture}}
    return made


def _surface(material: bpy.types.Material) -> bpy.types.Node | None:
    """The shader at the output, if it is one of `KINDS`."""
    output = material.node_tree and material.node_tree.get_output_node("ALL")
    links = output.inputs["Surface"].links if output else ()
    return links[0].from_node if links and links[0].from_node.type in KINDS else None


def _colour(
    socket: bpy.types.NodeSocket, material: bpy.types.Material, images: Images, lost: set[str]
) -> tuple[list[float], int | None]:
    """Linear colour of a socket, and the number of the image that is linked to it."""
    if socket.is_linked:
        node = socket.links[0].from_node
        if node.type == "TEX_IMAGE" and node.image is not None:
            return [1.0, 1.0, 1.0], images.number(node.image)
        lost.add(f"material {material.name}: {socket.name} is made by nodes that are no image: the socket's own value")
    return list(socket.default_value)[:3], None


def _number(node: bpy.types.Node, name: str, material: bpy.types.Material, lost: set[str]) -> float:
    socket = node.inputs[name]
    if socket.is_linked:
        lost.add(f"material {material.name}: {name} is made by nodes: the socket's own value stands in its place")
    return float(socket.default_value)


def _encoded(values: np.ndarray) -> np.ndarray:
    """Linear numbers in the curve of sRGB (IEC 61966-2-1)."""
    values = np.clip(values, 0.0, 1.0)
    return np.where(values <= 0.0031308, 12.92 * values, 1.055 * values ** (1.0 / 2.4) - 0.055)
