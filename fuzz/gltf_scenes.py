"""A good sample of a glTF scene: a mesh with textures of colour and gloss in the JSON, a camera and a lamp."""

from __future__ import annotations

import base64
import json
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from fuzz.meshes import ARRAYS, FLOAT, gltf_record

UV = np.array([[0, 0], [1, 0], [0, 1], [1, 1]], np.float32)


def scene(path: Path) -> None:
    """Text; its base colour is a factor times a PNG of 2 × 2 pixels, its gloss another PNG."""
    from hagoromo.files.png import png_bytes

    record = gltf_record(_data(ARRAYS + UV.tobytes()))
    record["bufferViews"].append({"buffer": 0, "byteOffset": len(ARRAYS), "byteLength": UV.nbytes})
    record["buffers"][0]["byteLength"] += UV.nbytes
    record["accessors"].append({"bufferView": 2, "componentType": FLOAT, "count": 4, "type": "VEC2"})
    first = record["meshes"][0]["primitives"][0]
    first["attributes"]["TEXCOORD_0"], first["material"] = 3, 0
    pixels = np.arange(12, dtype=np.uint8).reshape(2, 2, 3)
    light = {"type": "spot", "intensity": 3.0, "spot": {"outerConeAngle": 0.6}}
    gloss = np.arange(90, 154, 4, dtype=np.uint8).reshape(2, 2, 4)
    pbr = {"baseColorFactor": [0.5, 1, 1, 1], "baseColorTexture": {"index": 0}, "metallicFactor": 0.0}
    specular = {"specularFactor": 0.5, "specularColorFactor": [1.0, 0.9, 0.8], "specularTexture": {"index": 1}}
    material = {"extensions": {"KHR_materials_specular": specular, "KHR_materials_ior": {"ior": 1.4}}}
    record |= {
        "materials": [{"pbrMetallicRoughness": pbr | {"metallicRoughnessTexture": {"index": 1}}, **material}],
        "textures": [{"source": 0, "sampler": 0}, {"source": 1}],
        "samplers": [{"magFilter": 9728}],
        "images": [{"uri": _data(png_bytes(pixels))}, {"uri": _data(png_bytes(gloss))}],
        "cameras": [{"type": "perspective", "perspective": {"yfov": 0.8, "znear": 0.1}}],
        "extensions": {"KHR_lights_punctual": {"lights": [light]}},
    }
    record["nodes"][1] |= {"camera": 0, "extensions": {"KHR_lights_punctual": {"light": 0}}}
    path.write_text(json.dumps(record), encoding="utf-8")


def _data(content: bytes) -> str:
    return "data:application/octet-stream;base64," + base64.b64encode(content).decode()


def read(path: Path) -> Any:
    """The scene as ours, in a folder that goes away."""
    from hagoromo_formats.scenes.gltf_scene import scene_from_gltf

    with tempfile.TemporaryDirectory() as folder:
        return scene_from_gltf(path, Path(folder) / "out")
