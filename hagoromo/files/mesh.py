"""Mesh files: all formats that trimesh reads; the parts of a file are joined to one mesh."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from hagoromo.errors import InputError
from hagoromo.files.checks import existing_file
from hagoromo.files.memory import require


def read_mesh(path: str | Path) -> Any:
    """The `trimesh.Trimesh` in a file; `InputError` when it is missing, damaged, too large, or has no triangles."""
    import trimesh

    require(20 * existing_file(path).stat().st_size, str(path))
    try:
        mesh = trimesh.load(str(path), force="mesh")
    except Exception as error:
        raise InputError(f"{path} cannot be read as a mesh: {' '.join(str(error).split())}") from error
    if not isinstance(mesh, trimesh.Trimesh) or not len(mesh.faces):
        raise InputError(f"{path} holds no triangles: give a mesh (PLY, OBJ, STL, GLB, …)")
    return mesh
