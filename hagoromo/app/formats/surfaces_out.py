"""Surfaces out: a mesh as PLY, OBJ, STL, OFF or GLB, by trimesh, or as USD; places alone, without colours."""

from __future__ import annotations

from pathlib import Path

from hagoromo.app.formats.usd_out import write_usd_mesh
from hagoromo.errors import InputError
from hagoromo.files.mesh import read_mesh
from hagoromo.files.usd_stage import USD
from hagoromo.files.whole import replaceable_file, whole_file

WRITTEN = (".ply", ".obj", ".stl", ".off", ".glb", *USD)


def write_surface(source: str | Path, out: str | Path, force: bool = False) -> None:
    """Write the mesh in the file `source` as another; `InputError` for a suffix that is not in WRITTEN."""
    out = Path(out)
    if out.suffix.lower() not in WRITTEN:
        raise InputError(f"{source} is a mesh, which is written as {', '.join(WRITTEN)}: given {out.name}")
    replaceable_file(out, force)
    mesh = read_mesh(source)
    if out.suffix.lower() in USD:
        write_usd_mesh(mesh.vertices, mesh.faces, out, force)
        return
    data = mesh.export(file_type=out.suffix.lower()[1:])
    with whole_file(out, force) as partial:
        partial.write_bytes(data.encode() if isinstance(data, str) else bytes(data))
