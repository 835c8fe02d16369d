"""Meshes of a scene as glTF 2.0: what is seen, as it is deformed, in the world of Blender (z up, metres)."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from .look import Images, look_of
from .motion import OpenShutter, key_of
from .relief import ReliefFiles

FLOAT, WORD = 5126, 5125  # component types of glTF
FLAT = np.full((1, 1, 3), (0.5, 0.5, 1.0), np.float32)  # normals that turn nothing
OF_MESHES = ("MESH", "CURVE", "SURFACE", "FONT", "META")


class GltfFile:
    """A .gltf that grows mesh by mesh; its numbers lie in one .bin beside it."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.images, self.lost = folder, Images(folder), set[str]()
        self.textures = ReliefFiles(folder)
        self.parts: list[bytes] = []
        self.meshes: list[dict[str, Any]] = []  # what the nodes of meshes, called by their numbers, are in a scene.toml
        self.looks: dict[str, int] = {}
        self.record: dict[str, Any] = {
            "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": []}], "nodes": [], "meshes": [],
            "materials": [], "accessors": [], "bufferViews": [], "extensions": {"KHR_lights_punctual": {"lights": []}},
            "extensionsUsed": ["KHR_lights_punctual"],
        }  # fmt: skip

    def add(self, each: bpy.types.DepsgraphObjectInstance, motion: OpenShutter) -> None:
        """The mesh of an evaluated object, a primitive for each of its materials."""
        shown, pose = each.object, each.matrix_world.copy()
        mesh = shown.to_mesh()
        if mesh is None or not len(mesh.polygons):
            return
        mesh.calc_loop_triangles()
        count = len(mesh.loop_triangles)
        corners, faces = (
            whole_numbers(mesh.loop_triangles, "loops", 3),
            whole_numbers(mesh.loop_triangles, "polygon_index", 1),
        )
        which = whole_numbers(mesh.polygons, "material_index", 1)[faces[:, 0]][:, 0]
        vertices = whole_numbers(mesh.loops, "vertex_index", 1)[:, 0]
        places = np.empty(3 * len(mesh.vertices), np.float32)
        mesh.vertices.foreach_get("co", places)
        turned = np.array(pose)
        places = places.reshape(-1, 3) @ turned[:3, :3].T + turned[:3, 3]
        if np.linalg.det(turned[:3, :3]) < 0.0:
            corners = corners[:, ::-1]
        smooth = bool(count) and mesh.polygons[0].use_smooth
        uv = None
        if mesh.uv_layers.active:
            uv = np.empty(2 * len(mesh.loops), np.float32)
            mesh.uv_layers.active.uv.foreach_get("vector", uv)
            uv = uv.reshape(-1, 2) * [1.0, -1.0] + [0.0, 1.0]  # of glTF: v goes down
        for slot in np.unique(which):
            of_slot = corners[which == slot].ravel()
            key = vertices[of_slot, None].astype(float) if smooth else np.arange(len(of_slot))[:, None]
            material = mesh.materials[slot] if slot < len(mesh.materials) else None
            number = self._look(material)
            tables = self.textures.tables(material, self.lost) if uv is not None else {}
            if uv is None and "normalTexture" in self.record["materials"][number]:
                self.lost.add(f"{shown.name}: its images of normals and heights, as it has no UVs")
            textured = uv is not None and ("baseColorTexture" in self._pbr(number) or bool(tables))
            if smooth and textured:
                assert uv is not None
                key = np.concatenate([key, uv[of_slot]], axis=1)
            _, first, index = np.unique(key, axis=0, return_index=True, return_inverse=True)
            kept = of_slot[first]
            place = motion.add("surface", len(self.meshes), key_of(each), pose, self.lost)
            corner = places[vertices[kept]]
            if place is not None:
                back = np.array(place.inverted())
                corner = corner @ back[:3, :3].T + back[:3, 3]
            attributes = {"POSITION": self.accessor(corner, "VEC3")}
            if textured:
                assert uv is not None
                attributes["TEXCOORD_0"] = self.accessor(uv[kept], "VEC2")
            indices = self.accessor(index.ravel().astype("<u4"), "SCALAR", WORD)
            primitive = {"attributes": attributes, "indices": indices, "material": number}
            self.record["nodes"].append({"mesh": len(self.record["meshes"]), "name": str(len(self.meshes))})
            self.record["meshes"].append({"primitives": [primitive]})
            at = {} if place is None else {"pose": np.array(place).ravel().tolist()}
            self.meshes.append({"name": shown.name, "smooth": smooth, **at, **tables})
        shown.to_mesh_clear()

    def lamp(self, name: str, colour: Sequence[float]) -> None:
        """A lamp for its spectrum alone: Hagoromo makes a smooth one of its colour."""
        lights = self.record["extensions"]["KHR_lights_punctual"]["lights"]
        lights.append({"type": "point", "name": name, "color": [max(min(each, 1.0), 0.0) for each in colour]})
        at = {"KHR_lights_punctual": {"light": len(lights) - 1}}
        self.record["nodes"].append({"name": name, "extensions": at})

    def write(self) -> Path:
        """scene.gltf and scene.bin."""
        held = b"".join(self.parts)
        (self.folder / "scene.bin").write_bytes(held)
        self.record["buffers"] = [{"uri": "scene.bin", "byteLength": len(held)}]
        self.record["scenes"][0]["nodes"] = list(range(len(self.record["nodes"])))
        self.record["images"] = [{"uri": name} for name in self.images.names]
        self.record["textures"] = [{"source": number} for number in range(len(self.images.names))]
        for key in [key for key, value in self.record.items() if value == []]:
            del self.record[key]
        (self.folder / "scene.gltf").write_text(json.dumps(self.record), encoding="utf-8")
        return self.folder / "scene.gltf"

    def _pbr(self, number: int) -> dict[str, Any]:
        return self.record["materials"][number]["pbrMetallicRoughness"]

    def _look(self, material: bpy.types.Material | None) -> int:
        name = material.name if material else ""
        if name not in self.looks:
            self.looks[name] = len(self.record["materials"])
            look = look_of(material, self.images, self.lost)
            if {"normal_texture", "bump_texture"} & self.textures.tables(material, set()).keys():
                look |= {"normalTexture": {"index": self.images.named("flat.png", FLAT)}}  # keeps the UVs
            self.record["materials"].append(look)
        return self.looks[name]

    def accessor(self, values: np.ndarray, kind: str, of: int = FLOAT) -> int:
        """Number of new numbers (n,) or (n, 2 or 3) in the file."""
        held = np.ascontiguousarray(values, "<f4" if of == FLOAT else "<u4")
        begin = sum(map(len, self.parts))
        self.parts.append(held.tobytes())
        views, accessors = self.record["bufferViews"], self.record["accessors"]
        views.append({"buffer": 0, "byteOffset": begin, "byteLength": held.nbytes})
        facts = {"bufferView": len(views) - 1, "componentType": of, "count": len(held), "type": kind}
        if kind == "VEC3":
            facts |= {"min": held.min(axis=0).tolist(), "max": held.max(axis=0).tolist()}
        accessors.append(facts)
        return len(accessors) - 1


def whole_numbers(items: Any, name: str, width: int) -> np.ndarray:
    """(n, width) whole numbers of a collection of Blender's."""
    values = np.empty(width * len(items), np.int32)
    items.foreach_get(name, values)
    return values.reshape(-1, width)
