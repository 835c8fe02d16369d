"""Mesh parts: a mesh with the material of each face and its UV map, as OBJ, glTF and PLY know them.

Materials are `usemtl` of OBJ, those of the primitives of glTF, by name, and colours of the faces of PLY ("#ff0000").
Their colours, textures and libraries (`.mtl`) are not read.
"""

from __future__ import annotations

import io
import re
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.checks import read_bytes, sized_file
from hagoromo.files.mesh import GROWTH, LARGEST_MESH, read_gltf, read_mesh, uv_of
from hagoromo.files.reading import reading
from hagoromo.files.silence import trimesh_silenced

USED = re.compile(rb"^\s*usemtl[ \t]+(\S[^\r\n]*)", re.MULTILINE)  # of an OBJ
LIBRARY = "materials"  # what the OBJ that trimesh is given calls its library


class MeshParts(NamedTuple):
    """vertices (n, 3), faces (m, 3), the number of the material of each face in `names` ("": none), uv (n, 2) or None.

    Vertices that differ by uv alone are several.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    material: NDArray[np.int64]
    names: tuple[str, ...]
    uv: NDArray[np.float64] | None


def read_parts(path: str | Path) -> MeshParts:
    """The mesh in a file with its materials and its UV map; `InputError` as of `read_mesh`."""
    suffix = Path(path).suffix.lower()
    if suffix in (".glb", ".gltf"):
        scene = read_gltf(path)[1]
    elif suffix == ".obj":
        scene = _obj(path)
    else:
        return _of_colours(path, suffix)
    pieces, names = [], {}
    for node in scene.graph.nodes_geometry:
        place, name = scene.graph[node]
        mesh = scene.geometry[name]
        if hasattr(mesh, "faces") and len(mesh.faces):
            used = str(getattr(getattr(mesh.visual, "material", None), "name", None) or "")
            pieces.append((mesh.copy().apply_transform(place), names.setdefault(used, len(names))))
    if not pieces:
        raise InputError(f"{path} holds no triangles: give a mesh (PLY, OBJ, STL, GLB, …)")
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh, _ in pieces)])
    uvs = [uv_of(mesh) for mesh, _ in pieces]
    return MeshParts(
        np.concatenate([np.asarray(mesh.vertices, float) for mesh, _ in pieces]),
        np.concatenate([np.asarray(mesh.faces) + start for (mesh, _), start in zip(pieces, starts, strict=False)]),
        np.repeat([number for _, number in pieces], [len(mesh.faces) for mesh, _ in pieces]),
        tuple(names),
        None if any(uv is None for uv in uvs) else np.concatenate([uv for uv in uvs if uv is not None]),
    )


def _obj(path: str | Path) -> Any:
    """The `trimesh.Scene` of an OBJ: a part for each `usemtl`. Its library is one that has the names alone."""
    import trimesh
    from trimesh.resolvers import Resolver

    data = read_bytes(sized_file(path, LARGEST_MESH, "a mesh file"), GROWTH[".obj"])

    class Names(Resolver):
        def __init__(self) -> None:
            pass

        def get(self, key: str) -> bytes:
            return b"".join(b"newmtl %s\n" % name.strip() for name in dict.fromkeys(USED.findall(data)))

        def keys(self) -> tuple[str, ...]:
            return ()

        def write(self, name: str, data: Any) -> None:
            raise InputError(f"{name} is not written: a mesh is only read")

        def namespaced(self, namespace: str) -> Any:
            return self

    with reading(path, "a mesh"), trimesh_silenced():
        text = f"mtllib {LIBRARY}\n".encode() + data
        return trimesh.load_scene(io.BytesIO(text), file_type="obj", resolver=Names(), process=False)


def _of_colours(path: str | Path, suffix: str) -> MeshParts:
    """The mesh of a file without names: the colours of its faces are their materials."""
    mesh = read_mesh(path, process=False)
    number, names = np.zeros(len(mesh.faces), np.int64), ("",)
    if suffix == ".ply" and mesh.visual.kind == "face":
        colours, number = np.unique(np.asarray(mesh.visual.face_colors)[:, :3], axis=0, return_inverse=True)
        names = tuple(f"#{r:02x}{g:02x}{b:02x}" for r, g, b in colours.tolist())
    return MeshParts(np.asarray(mesh.vertices, float), np.asarray(mesh.faces), number.ravel(), names, uv_of(mesh))
