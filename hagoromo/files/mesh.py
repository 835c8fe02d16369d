"""Mesh files: PLY, OBJ, STL, OFF and glTF, read by trimesh; those of other packages by what the table of formats names.

The parts of a file are joined to one mesh. Archives are not opened, nor textures, nor addresses; a glTF may name files
of its own folder.

Mesh parts: a mesh with the material of each face and its UV map, as OBJ, glTF and PLY know them.

Materials are `usemtl` of OBJ, those of the primitives of glTF, by name, and colours of the faces of PLY ("#ff0000").
Their colours, textures and libraries (`.mtl`) are not read.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.apart import prepare, read_apart
from hagoromo.files.checks import read_bytes, sized_file
from hagoromo.files.format import Format, formats_of, function_at
from hagoromo.files.gltf import SUFFIXES, gltf_record
from hagoromo.files.memory import require
from hagoromo.files.mesh_trimesh import LARGEST_MESH, mesh_by_trimesh, parts_by_trimesh
from hagoromo.files.reading import reading
from hagoromo.files.whole import whole_file


def read_mesh(path: str | Path, process: bool = True) -> Any:
    """The `trimesh.Trimesh` in a file; `InputError` when it is missing, damaged, too large, or has no triangles.

    It is read in a process apart. process: whether vertices in one place are joined.
    """
    form = mesh_format(path)
    file = sized_file(path, LARGEST_MESH, "a mesh file")
    require(form.growth * file.stat().st_size, str(file))
    if form.triangles:
        import trimesh

        mesh = trimesh.Trimesh(*function_at(form.triangles)(file))
    else:
        prepare("trimesh")  # while it is loaded here, too
        import trimesh

        mesh = _mesh_of(read_apart(mesh_by_trimesh, file, "a mesh", process))
    if not len(mesh.faces):
        raise InputError(f"{path} holds no triangles: give a mesh (PLY, OBJ, STL, GLB, …)")
    if mesh.vertices.shape[1:] != (3,):
        raise InputError(f"{path} has vertices of {mesh.vertices.shape[1]} coordinates: give a mesh with x, y, z")
    return mesh


def write_mesh(vertices: Any, faces: Any, out: str | Path, force: bool = False) -> None:
    """Write a mesh, places alone, as PLY, OBJ, STL, OFF or GLB; vertices: (n, 3); faces: (m, 3) of their numbers."""
    import trimesh

    data = trimesh.Trimesh(vertices, faces, process=False).export(file_type=Path(out).suffix.lower()[1:])
    with whole_file(out, force) as partial:
        partial.write_bytes(data.encode() if isinstance(data, str) else bytes(data))


def mesh_format(path: str | Path) -> Format:
    """The format of a mesh, by the suffix of its name; `InputError` for one that holds none."""
    known = [form for form in formats_of("surface", "scene") if form.growth]
    suffix = Path(path).suffix.lower()
    form = next((form for form in known if suffix in form.suffixes), None)
    if form is None:
        names = ", ".join(suffix for form in known for suffix in form.suffixes)
        raise InputError(f"{path} is no mesh file of a known format: give one of {names}")
    return form


def _mesh_of(arrays: Mapping[str, Any]) -> Any:
    """The mesh in the arrays of `mesh_by_trimesh`: vertices, faces, and uv and colours where there are any."""
    import trimesh
    from trimesh.visual import ColorVisuals, TextureVisuals

    visual: Any = TextureVisuals(uv=arrays["uv"]) if "uv" in arrays else None
    for kind in ("vertex_colors", "face_colors"):
        if kind in arrays:
            visual = ColorVisuals(**{kind: arrays[kind]})
    attributes = {"color": arrays["color"]} if "color" in arrays else None
    return trimesh.Trimesh(
        arrays["vertices"], arrays["faces"], process=False, visual=visual, vertex_attributes=attributes
    )


def read_coloured_mesh(path: str | Path) -> Any:
    """As `read_mesh`, but that vertices in one place stay apart where their colours differ."""
    mesh = read_mesh(path, process=False)
    rows = np.column_stack([mesh.vertices, vertex_colours_of(mesh, path)[0]])
    _, first, inverse = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    if len(first) == len(np.unique(mesh.vertices, axis=0)):
        return read_mesh(path)
    mesh.update_vertices(first, inverse.ravel())
    return mesh


def uv_of(mesh: Any) -> Any:
    """UVs (n, 2) of the vertices of a mesh that `read_mesh` gave, v up; None where it has none."""
    uv = getattr(mesh.visual, "uv", None)
    if uv is None or np.shape(uv) != (len(mesh.vertices), 2):
        return None
    return np.asarray(uv, np.float64)


def vertex_colours_of(mesh: Any, path: str | Path) -> tuple[Any, bool]:
    """R, G, B (n, 3), 0…1, of the vertices of a mesh that `read_mesh` gave, and whether they are encoded as sRGB:
    those of a glTF are linear. `InputError` where it has none.
    """
    colours = mesh.visual.vertex_colors if mesh.visual.kind == "vertex" else mesh.vertex_attributes.get("color")
    if colours is None or np.ndim(colours) != 2 or np.shape(colours)[0] != len(mesh.vertices):
        raise InputError(f"{path} has no colours of its vertices: give a mesh that has them, or an image")
    stored = np.asarray(colours)[:, :3]
    stored = stored / 255.0 if stored.dtype == np.uint8 else stored  # in OBJ they are 0…1
    if not ((stored >= 0.0) & (stored <= 1.0)).all():
        raise InputError(f"{path} has colours of vertices outside 0…1: correct them")
    return stored, Path(path).suffix.lower() not in (".glb", ".gltf")


class MeshPart(NamedTuple):
    """vertices (n, 3), at their place, and faces (m, 3); uv (n, 2), v up; colours (n, 3 or 4) as the file has them.

    material: its name; in a glTF that is read `numbered` its number, −1 without one. node: name of its node, as the
    library that reads it has it: made up where the file has none.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    uv: NDArray[np.float64] | None
    colours: NDArray[Any] | None
    material: str
    node: str


def read_gltf(path: str | Path, numbered: bool = False) -> tuple[dict[str, Any], list[MeshPart]]:
    """The JSON of a .glb or .gltf file, checked, and its meshes, each once for every place, without textures.

    numbered: whether the names of the materials of its meshes are replaced by their numbers in the file.
    `InputError` as of `read_mesh`.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(f"{path} is no glTF: give a .glb or .gltf")
    file = sized_file(path, LARGEST_MESH, "a mesh file")
    with reading(path, "glTF"):
        record = gltf_record(read_bytes(file, mesh_format(file).growth), suffix, str(file))
    return record, parts_apart(file, numbered)


def parts_apart(file: Path, numbered: bool = False) -> list[MeshPart]:
    """The parts of an OBJ or a glTF, read in a process apart."""
    arrays = read_apart(parts_by_trimesh, file, "a mesh", numbered)
    materials, nodes = (json.loads(arrays[key].tobytes()) for key in ("materials", "nodes"))
    return [
        MeshPart(arrays[f"v{k}"], arrays[f"f{k}"], arrays.get(f"u{k}"), arrays.get(f"c{k}"), *names)
        for k, names in enumerate(zip(materials, nodes, strict=True))
    ]


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


def fans(counts: NDArray[np.int64], corners: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Triangles (m, 3) around the first corner of each polygon, and the polygon of each (m).

    counts: how many corners each polygon has; corners: those of all, one after the other. `ValueError` where the two
    do not fit.
    """
    if counts.size and (counts.min() < 0 or counts.sum() != corners.size):
        raise ValueError("its polygons have other corners than they state")
    parts = np.maximum(counts - 2, 0)
    polygon = np.repeat(np.arange(len(counts)), parts)
    first = (np.cumsum(counts) - counts)[polygon]
    step = np.arange(len(polygon)) - (np.cumsum(parts) - parts)[polygon]
    return np.stack([corners[first], corners[first + step + 1], corners[first + step + 2]], axis=1), polygon
