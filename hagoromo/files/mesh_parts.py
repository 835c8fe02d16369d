"""Mesh parts: a mesh with the material of each face and its UV map, as OBJ, glTF and PLY know them.

Materials are `usemtl` of OBJ, those of the primitives of glTF, by name, and colours of the faces of PLY ("#ff0000").
Their colours, textures and libraries (`.mtl`) are not read.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.checks import sized_file
from hagoromo.files.gltf import SUFFIXES
from hagoromo.files.memory import require
from hagoromo.files.mesh import mesh_format, parts_apart, read_gltf, read_mesh, uv_of
from hagoromo.files.mesh_trimesh import LARGEST_MESH


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
    if suffix == ".obj":
        file = sized_file(path, LARGEST_MESH, "a mesh file")
        require(mesh_format(path).growth * file.stat().st_size, str(file))
        parts = parts_apart(file)
    elif suffix in SUFFIXES:
        parts = read_gltf(path)[1]
    else:
        return _of_colours(path, suffix)
    if not parts:
        raise InputError(f"{path} holds no triangles: give a mesh (PLY, OBJ, STL, GLB, …)")
    names = list(dict.fromkeys(part.material for part in parts))
    starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    uvs = [part.uv for part in parts]
    return MeshParts(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.faces + start for part, start in zip(parts, starts, strict=False)]),
        np.repeat([names.index(part.material) for part in parts], [len(part.faces) for part in parts]),
        tuple(names),
        None if any(uv is None for uv in uvs) else np.concatenate([uv for uv in uvs if uv is not None]),
    )


def _of_colours(path: str | Path, suffix: str) -> MeshParts:
    """The mesh of a file without names: the colours of its faces are their materials."""
    mesh = read_mesh(path, process=False)
    number, names = np.zeros(len(mesh.faces), np.int64), ("",)
    if suffix == ".ply" and mesh.visual.kind == "face":
        colours, number = np.unique(np.asarray(mesh.visual.face_colors)[:, :3], axis=0, return_inverse=True)
        names = tuple(f"#{r:02x}{g:02x}{b:02x}" for r, g, b in colours.tolist())
    return MeshParts(np.asarray(mesh.vertices, float), np.asarray(mesh.faces), number.ravel(), names, uv_of(mesh))
