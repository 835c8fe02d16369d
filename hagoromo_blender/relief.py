"""Images of normals and heights of Blender's materials, and images by UDIM, as textures of a scene.toml."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from .look import pixels_of, write_image

UDIM = "<UDIM>"
FILES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".exr")
OF_UVS = ("UVMAP", "TEX_COORD")


class ReliefFiles:
    """Files of textures in the folder of a scene, by image and what is made of it."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.known = folder, dict[Any, str]()

    def tables(self, material: bpy.types.Material | None, lost: set[str]) -> dict[str, Any]:
        """The tables body_texture (of images by UDIM), normal_texture and bump_texture of a Principled material."""
        node = _principled(material)
        if material is None or node is None:
            return {}
        who, found = f"material {material.name}", {}
        base, relief = image_at(node.inputs["Base Color"], who, lost), _reliefs(node.inputs["Normal"], who, lost)
        images = [image for image in (base, *(image for image, _ in relief.values())) if image is not None]
        numbers = [{tile.number for tile in image.tiles} for image in images if image.source == "TILED"]
        tiles = sorted(set.intersection(*numbers)) if numbers else []
        if base is not None and tiles:
            found["body_texture"] = {"file": self.file(base, tiles, who, lost)}
        for key, (image, numbers_of) in relief.items():
            found[key] = {"file": self.file(image, tiles, who, lost, **numbers_of)}
            if key == "bump_texture":
                found[key]["height_mm"] = numbers_of["height_mm"]
        if any(table["file"] is None for table in found.values()):
            return {}
        return found

    def file(
        self, image: bpy.types.Image, tiles: list[int], who: str, lost: set[str], strength: float = 1.0,
        green: float = 1.0, height_mm: float | None = None,
    ) -> str | None:  # fmt: skip
        """The name of the file, or files by UDIM; None where a tile has none, which is said."""
        plain = strength == 1.0 and green == 1.0
        key = image.name, tuple(tiles), strength, green, height_mm is None
        if key in self.known:
            return self.known[key]
        stem = f"texture_{len(self.known)}"
        if image.source == "TILED":
            source = Path(bpy.path.abspath(image.filepath_raw or image.filepath))
            places = {tile: Path(str(source).replace(UDIM, str(tile))) for tile in tiles}
            missing = [place for place in places.values() if not place.is_file()]
            if missing or source.suffix.lower() not in FILES or not plain:
                why = f"{missing[0].name} is not on the disk" if missing else "its strength, or its kind of file"
                lost.add(f"{who}: its image {image.name} by UDIM: {why}")
                return None
            for tile, place in places.items():
                shutil.copyfile(place, self.folder / f"{stem}.{tile}{place.suffix.lower()}")
            self.known[key] = f"{stem}.{UDIM}{source.suffix.lower()}"
            return self.known[key]
        values = _linear(image)
        if not plain:  # as Cycles has it
            normal = 2.0 * values - 1.0
            normal[..., 1] *= green
            normal = normal * [strength, strength, 1.0]
            normal[..., 2] = 1.0 + min(max(strength, 0.0), 1.0) * (normal[..., 2] - 1.0)
            values = 0.5 + 0.5 * normal / np.maximum(np.linalg.norm(normal, axis=2, keepdims=True), 1e-9)
        names = [f"{stem}.{tile}.exr" for tile in tiles] or [f"{stem}.exr"]
        for name in names:
            write_image(self.folder / name, np.clip(values, 0.0, None))
        self.known[key] = f"{stem}.{UDIM}.exr" if tiles else f"{stem}.exr"
        return self.known[key]


def image_at(socket: bpy.types.NodeSocket, who: str, lost: set[str]) -> bpy.types.Image | None:
    """The image that is linked to a socket; where it lies on other than its UVs, a line says so."""
    node = socket.links[0].from_node if socket.is_linked else None
    if node is None or node.type != "TEX_IMAGE" or node.image is None:
        return None
    place = node.inputs["Vector"]
    if place.is_linked and place.links[0].from_node.type not in OF_UVS:
        lost.add(f"{who}: how its image {node.image.name} is moved on its UVs")
    return node.image


def _reliefs(socket: bpy.types.NodeSocket, who: str, lost: set[str]) -> dict[str, tuple[bpy.types.Image, Any]]:
    """Images of the nodes Bump and Normal Map at a socket, one behind the other, and their numbers."""
    found: dict[str, tuple[bpy.types.Image, Any]] = {}
    node = socket.links[0].from_node if socket.is_linked else None
    if node is not None and node.type == "BUMP":
        image = image_at(node.inputs["Height"], who, lost)
        strength, distance = (float(node.inputs[name].default_value) for name in ("Strength", "Distance"))
        if image is None:
            lost.add(f"{who}: its bump is made by nodes that are no image")
        else:
            if strength != 1.0:
                lost.add(f"{who}: the strength of its bump, which is taken as a factor on its heights")
            height = 1000.0 * distance * strength * (-1.0 if node.invert else 1.0)
            found["bump_texture"] = image, {"height_mm": height}
        behind = node.inputs["Normal"]
        node = behind.links[0].from_node if behind.is_linked else None
    if node is not None:
        image = image_at(node.inputs["Color"], who, lost) if node.type == "NORMAL_MAP" else None
        if image is None or node.space != "TANGENT":
            lost.add(f"{who}: its normals are made by nodes that are no image in tangent space")
        else:
            green = -1.0 if getattr(node, "convention", "OPENGL") == "DIRECTX" else 1.0
            found["normal_texture"] = image, {"strength": float(node.inputs["Strength"].default_value), "green": green}
    return found


def _principled(material: bpy.types.Material | None) -> bpy.types.Node | None:
    output = material and material.node_tree and material.node_tree.get_output_node("ALL")
    links = output.inputs["Surface"].links if output else ()
    return links[0].from_node if links and links[0].from_node.type == "BSDF_PRINCIPLED" else None


def _linear(image: bpy.types.Image) -> np.ndarray:
    """(height, width, 3) numbers as nodes have them."""
    values = pixels_of(image)
    if image.is_float or image.colorspace_settings.name != "sRGB":
        return values
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)
