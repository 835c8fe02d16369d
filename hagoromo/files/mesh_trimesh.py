"""Meshes by trimesh, as arrays; run by `read_apart`. Archives are not opened, nor textures, nor addresses.

A glTF may name files of its own folder. The library of materials of an OBJ with parts is one that has names alone.
"""

from __future__ import annotations

import io
import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.checks import inside, read_bytes, sized_file
from hagoromo.files.gltf import START, SUFFIXES, gltf_record
from hagoromo.files.reading import reading, trimesh_silenced

LARGEST_MESH = 1 << 32  # bytes, of each file of a mesh
USED = re.compile(rb"^\s*usemtl[ \t]+(\S[^\r\n]*)", re.MULTILINE)  # of an OBJ
LIBRARY = "materials"  # what the OBJ that trimesh is given calls its library
NOT_READ = ("images", "textures", "samplers", "cameras", "animations", "skins", "extensions", "extras", "asset")
Arrays = dict[str, NDArray[Any]]


def mesh_by_trimesh(path: Path, process: bool) -> Arrays:
    """vertices (n, 3) and faces (m, 3), none where there are no triangles; uv, vertex_colors, face_colors or color."""
    import trimesh

    suffix, data = path.suffix.lower(), read_bytes(path)
    with reading(path, "a mesh"), trimesh_silenced():
        if suffix in SUFFIXES:
            data = _with_record(data, gltf_record(data, suffix, str(path)), suffix, False)
        mesh: Any = trimesh.load(
            io.BytesIO(data), file_type=suffix[1:], force="mesh", resolver=_files(path.parent), skip_materials=True,
            process=process,
        )  # fmt: skip
        if not isinstance(mesh, trimesh.Trimesh):
            return {"vertices": np.zeros((0, 3)), "faces": np.zeros((0, 3), np.int64)}
        visual: Any = mesh.visual
        looks = {"color": mesh.vertex_attributes.get("color"), "uv": getattr(visual, "uv", None)}
        if visual.kind in ("vertex", "face"):
            looks = {key: getattr(visual, key) for key in (f"{visual.kind}_colors",)}
        arrays = {"vertices": mesh.vertices, "faces": mesh.faces, **looks}
        return {name: np.array(array) for name, array in arrays.items() if array is not None}


def parts_by_trimesh(path: Path, numbered: bool) -> Arrays:
    """Of each part k of an OBJ or a glTF, at its place: v{k}, f{k}; UVs u{k} and colours c{k}, where it has any.

    materials, nodes: their names, as JSON in bytes. numbered: a glTF's numbers of materials in place of their names.
    """
    import trimesh

    suffix, data = path.suffix.lower(), read_bytes(path)
    with reading(path, "a mesh"), trimesh_silenced():
        if suffix in SUFFIXES:
            data, files = (
                _with_record(data, gltf_record(data, suffix, str(path)), suffix, numbered),
                _files(path.parent),
            )
        else:
            data, files = f"mtllib {LIBRARY}\n".encode() + data, _names(data)
        scene: Any = trimesh.load_scene(io.BytesIO(data), file_type=suffix[1:], resolver=files, process=False)
        arrays, names, nodes = {}, [], []
        for node in scene.graph.nodes_geometry:
            place, name = scene.graph[node]
            mesh = scene.geometry[name]
            if hasattr(mesh, "faces") and len(mesh.faces):
                arrays |= _part(mesh, place, len(names))
                names.append(str(getattr(getattr(mesh.visual, "material", None), "name", None) or ""))
                nodes.append(str(node))
    lists = {"materials": names, "nodes": nodes}
    return arrays | {name: np.frombuffer(json.dumps(each).encode(), np.uint8) for name, each in lists.items()}


def _part(mesh: Any, place: NDArray[np.float64], number: int) -> Arrays:
    moved, visual = mesh.copy().apply_transform(place), mesh.visual
    uv = getattr(visual, "uv", None)
    colours = visual.vertex_colors if visual.kind == "vertex" else getattr(visual, "vertex_attributes", {}).get("color")
    found = {"v": np.asarray(moved.vertices, np.float64), "f": np.asarray(moved.faces, np.int64)}
    if uv is not None and np.shape(uv) == (len(mesh.vertices), 2):
        found["u"] = np.asarray(uv, np.float64)
    if colours is not None and np.ndim(colours) == 2 and len(colours) == len(mesh.vertices):
        found["c"] = np.asarray(colours)
    return {f"{key}{number}": array for key, array in found.items()}


def _with_record(data: bytes, record: Mapping[str, Any], suffix: str, numbered: bool) -> bytes:
    """The bytes of a glTF whose JSON has what is read alone: no textures, no extensions that a package may unpack."""
    plain = {key: value for key, value in record.items() if key not in NOT_READ}
    for kind in ("meshes", "nodes", "scenes"):
        plain[kind] = [{k: v for k, v in one.items() if k not in NOT_READ} for one in record.get(kind, ())]
    for mesh in plain["meshes"]:
        mesh["primitives"] = [{k: v for k, v in one.items() if k not in NOT_READ} for one in mesh["primitives"]]
    plain["materials"] = [_plain_material(one) for one in record.get("materials", ())]
    if numbered:
        plain["materials"] = [one | {"name": str(k)} for k, one in enumerate(plain["materials"])]
    text = json.dumps(plain).encode()
    if suffix == ".gltf":
        return text
    text += b" " * (-len(text) % 4)
    magic, version, _, old, kind = START.unpack_from(data)
    rest = data[START.size + old :]
    return START.pack(magic, version, START.size + len(text) + len(rest), len(text), kind) + text + rest


def _plain_material(material: Mapping[str, Any]) -> dict[str, Any]:
    """A material of glTF with its factors alone."""
    rough = material.get("pbrMetallicRoughness", {})
    kept = {key: rough[key] for key in ("baseColorFactor", "roughnessFactor") if key in rough}
    return {"name": str(material.get("name", "")), "pbrMetallicRoughness": kept}


def _files(folder: Path) -> Any:
    """What trimesh asks for the files that a mesh names: only those in its folder."""
    return _resolver(lambda name: read_bytes(sized_file(inside(folder, name), LARGEST_MESH, "a file of a mesh")))


def _names(data: bytes) -> Any:
    """The library of materials of an OBJ: their names alone, whatever it is called."""
    used = dict.fromkeys(name.strip() for name in USED.findall(data))
    return _resolver(lambda _: b"".join(b"newmtl %s\n" % name for name in used))


def _resolver(read: Any) -> Any:
    from trimesh.resolvers import Resolver

    class Files(Resolver):
        def __init__(self) -> None:
            pass

        def get(self, key: str) -> bytes:
            return read(key)

        def keys(self) -> Sequence[str]:
            return ()

        def write(self, name: str, data: Any) -> None:
            raise InputError(f"{name} is not written: a mesh is only read")

        def namespaced(self, namespace: str) -> Any:
            return self

    return Files()
