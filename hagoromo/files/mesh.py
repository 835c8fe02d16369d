"""Mesh files: PLY, OBJ, STL, OFF and glTF, read by trimesh, VTP by VTK, Alembic and USD by their own.

The parts of a file are joined to one mesh. Archives are not opened, nor textures, nor addresses; a glTF may name files
of its own folder.
"""

from __future__ import annotations

import io
import json
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from hagoromo.errors import InputError
from hagoromo.files.checks import inside, read_bytes, sized_file
from hagoromo.files.gltf import MOST_NODES, START, SUFFIXES, gltf_record
from hagoromo.files.memory import require
from hagoromo.files.mesh_abc import read_abc
from hagoromo.files.mesh_vtp import read_vtp
from hagoromo.files.reading import reading
from hagoromo.files.silence import trimesh_silenced
from hagoromo.files.usd_parts import read_usd_mesh
from hagoromo.files.usd_stage import USD

VTP, ABC = ".vtp", ".abc"
BY_LIBRARY: dict[str, Callable[[Path], tuple[Any, Any]]] = {
    VTP: read_vtp,
    ABC: read_abc,
    **dict.fromkeys(USD, read_usd_mesh),
}
# suffix → memory of the mesh while it is read and joined, in sizes of its file: of text of the shortest lines, of the
# smallest triangles in binary
GROWTH = {".ply": 40.0, ".obj": 60.0, ".stl": 30.0, ".off": 60.0, ".glb": 30.0, ".gltf": 30.0, VTP: 60.0, ABC: 300.0,
          **dict.fromkeys(USD, 60.0)}  # fmt: skip
LARGEST_MESH = 1 << 32  # bytes
BYTES_PER_ENTRY = 300.0  # memory of a corner or an index of a glTF, at every place where it stands


def read_mesh(path: str | Path, process: bool = True) -> Any:
    """The `trimesh.Trimesh` in a file; `InputError` when it is missing, damaged, too large, or has no triangles.

    process: whether vertices in one place are joined.
    """
    import trimesh

    suffix = Path(path).suffix.lower()
    if suffix not in GROWTH:
        raise InputError(f"{path} is no mesh file of a known format: give one of {', '.join(GROWTH)}")
    data = read_bytes(sized_file(path, LARGEST_MESH, "a mesh file"), GROWTH[suffix])
    with reading(path, "a mesh"), trimesh_silenced():
        if suffix in SUFFIXES:
            _check_gltf(gltf_record(data, suffix), str(path))
        files = _folder_files(Path(path).parent, GROWTH[suffix])
        mesh = (
            trimesh.Trimesh(*BY_LIBRARY[suffix](Path(path)))
            if suffix in BY_LIBRARY
            else trimesh.load(
                io.BytesIO(data),
                file_type=suffix[1:],
                force="mesh",
                resolver=files,
                skip_materials=True,
                process=process,
            )
        )
    if not isinstance(mesh, trimesh.Trimesh) or not len(mesh.faces):
        raise InputError(f"{path} holds no triangles: give a mesh (PLY, OBJ, STL, GLB, …)")
    if mesh.vertices.shape[1:] != (3,):
        raise InputError(f"{path} has vertices of {mesh.vertices.shape[1]} coordinates: give a mesh with x, y, z")
    return mesh


def read_coloured_mesh(path: str | Path) -> Any:
    """As `read_mesh`, but that vertices in one place stay apart where their colours differ."""
    import numpy as np

    mesh = read_mesh(path, process=False)
    rows = np.column_stack([mesh.vertices, vertex_colours_of(mesh, path)[0]])
    _, first, inverse = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    if len(first) == len(np.unique(mesh.vertices, axis=0)):
        return read_mesh(path)
    mesh.update_vertices(first, inverse.ravel())
    return mesh


def uv_of(mesh: Any) -> Any:
    """UVs (n, 2) of the vertices of a mesh that `read_mesh` gave, v up; None where it has none."""
    import numpy as np

    uv = getattr(mesh.visual, "uv", None)
    if uv is None or np.shape(uv) != (len(mesh.vertices), 2):
        return None
    return np.asarray(uv, np.float64)


def vertex_colours_of(mesh: Any, path: str | Path) -> tuple[Any, bool]:
    """R, G, B (n, 3), 0…1, of the vertices of a mesh that `read_mesh` gave, and whether they are encoded as sRGB:
    those of a glTF are linear. `InputError` where it has none.
    """
    import numpy as np

    colours = mesh.visual.vertex_colors if mesh.visual.kind == "vertex" else mesh.vertex_attributes.get("color")
    if colours is None or np.ndim(colours) != 2 or np.shape(colours)[0] != len(mesh.vertices):
        raise InputError(f"{path} has no colours of its vertices: give a mesh that has them, or an image")
    stored = np.asarray(colours)[:, :3]
    stored = stored / 255.0 if stored.dtype == np.uint8 else stored  # in OBJ they are 0…1
    if not ((stored >= 0.0) & (stored <= 1.0)).all():
        raise InputError(f"{path} has colours of vertices outside 0…1: correct them")
    return stored, Path(path).suffix.lower() not in (".glb", ".gltf")


def read_gltf(path: str | Path, numbered: bool = False) -> tuple[dict[str, Any], Any]:
    """The JSON of a .glb or .gltf file, and its meshes at their places, a `trimesh.Scene`, without textures.

    numbered: whether the names of the materials of its meshes are replaced by their numbers in the file, see
    `number_of_material`. `InputError` as of `read_mesh`.
    """
    import trimesh

    suffix = Path(path).suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(f"{path} is no glTF: give a .glb or .gltf")
    data = read_bytes(sized_file(path, LARGEST_MESH, "a mesh file"), GROWTH[suffix])
    with reading(path, "glTF"), trimesh_silenced():
        record = gltf_record(data, suffix)
        if not isinstance(record, dict):
            raise InputError(f"{path} holds no glTF: it is damaged")
        _check_gltf(record, str(path))
        plain = {key: value for key, value in record.items() if key not in ("images", "textures", "samplers")}
        plain["materials"] = [_plain_material(one) for one in _tables(record, "materials")]
        if numbered:
            plain["materials"] = [one | {"name": str(k)} for k, one in enumerate(plain["materials"])]
        files = _folder_files(Path(path).parent, GROWTH[suffix])
        scene = trimesh.load_scene(
            io.BytesIO(_with_record(data, plain, suffix)), file_type=suffix[1:], resolver=files, process=False
        )
    return record, scene


def number_of_material(mesh: Any) -> int:
    """Which of its file's materials a mesh has that `read_gltf` gave `numbered`; −1 for none."""
    name = str(getattr(getattr(mesh.visual, "material", None), "name", None) or "")
    return int(name) if name.isdecimal() else -1


def _plain_material(material: Mapping[str, Any]) -> dict[str, Any]:
    """A material of glTF with its factors alone."""
    rough = material.get("pbrMetallicRoughness")
    kept = {key: rough[key] for key in ("baseColorFactor", "roughnessFactor") if key in rough} if rough else {}
    return {"name": str(material.get("name", "")), "pbrMetallicRoughness": kept}


def _with_record(data: bytes, record: Mapping[str, Any], suffix: str) -> bytes:
    """The bytes of a glTF with another JSON."""
    text = json.dumps(record).encode()
    if suffix == ".gltf":
        return text
    text += b" " * (-len(text) % 4)
    magic, version, _, old, kind = START.unpack_from(data)
    rest = data[START.size + old :]
    return START.pack(magic, version, START.size + len(text) + len(rest), len(text), kind) + text + rest


def _folder_files(folder: Path, growth: float) -> Any:
    """What trimesh asks for the files that a mesh names: only those in its folder."""
    from trimesh.resolvers import Resolver

    class FolderFiles(Resolver):
        def __init__(self) -> None:
            pass

        def get(self, key: str) -> bytes:
            return read_bytes(sized_file(inside(folder, key), LARGEST_MESH, "a file of a mesh"), growth)

        def keys(self) -> Sequence[str]:
            return ()

        def write(self, name: str, data: Any) -> None:
            raise InputError(f"{name} is not written: a mesh is only read")

        def namespaced(self, namespace: str) -> Any:
            return self

    return FolderFiles()


def _check_gltf(record: Any, where: str) -> None:
    """Raise `InputError` for a glTF that becomes too large: its arrays, and its meshes at all places together."""
    accessors, meshes, nodes = (_tables(record, name) for name in ("accessors", "meshes", "nodes"))
    if len(nodes) > MOST_NODES:
        raise InputError(f"{where} has {len(nodes)} nodes, a glTF {MOST_NODES} at most: join its parts")
    counts = [_whole(accessor.get("count")) for accessor in accessors]
    sizes = [
        sum(
            counts[k]
            for part in _tables(mesh, "primitives")
            for k in (part.get("indices"), *dict(part.get("attributes") or {}).values())
            if isinstance(k, int) and 0 <= k < len(counts)
        )
        for mesh in meshes
    ]
    stand = [_whole(node["mesh"]) for node in nodes if "mesh" in node]
    placed = sum(sizes[int(k)] for k in stand if k < len(sizes))
    require(BYTES_PER_ENTRY * (sum(counts) + placed), where)


def _tables(record: Any, name: str) -> list[Mapping[str, Any]]:
    entries = record.get(name) if isinstance(record, Mapping) else None
    return [entry for entry in entries or () if isinstance(entry, Mapping)]


def _whole(value: Any) -> float:
    """A count; infinite where it is none, so that nothing with it fits."""
    return value if isinstance(value, int) and not isinstance(value, bool) and value >= 0 else math.inf
