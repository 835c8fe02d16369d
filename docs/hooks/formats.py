"""The page of file formats, written from the table that `convert`, `info` and their messages go by."""

from __future__ import annotations

from typing import Any

from mkdocs.structure.files import File

PAGE = "reference/formats.md"
HEAD = """# Formats

What is read and written, by which library, which independent reader the tests compare with, and what is lost.
`hagoromo info FILE` says what is in any of them; `hagoromo convert` turns one into another. This page is
written from the table in the code. What a table names in an extra is installed by `pip install
'hagoromo[volumes]'` (pynrrd, nibabel, h5py), `'hagoromo[vtk]'`, `'hagoromo[usd]'` (usd-core), `'hagoromo[alembic]'`,
`'hagoromo[lenses]'` (lensfunpy) and `'hagoromo[display]'` (OpenColorIO). A file that holds several
volumes is followed by a colon and the name of one: `smoke.vdb:flame`, `scan.h5:entry/density`. Lengths of
OpenVDB, NanoVDB and `.vol` are metres, those of VTI and SLC millimetres.

Rules of volumes: the file's first index is x, its second y, its third z, and the box lies where the file says,
in metres. Voxels of unequal edges become cubes of the shortest edge, by linear interpolation. A left-handed
lattice is read from its last layer to its first; one that is not at right angles is refused. Whole numbers are
no densities: state `--scale` (the density that 1 stands for) or `--window` (the numbers of density 0 and of
density 1). Without axes of their own, micro-elements point down the slope of the density.
"""
COLUMNS = "| format | suffixes | in | out | read by | tests compare with | lost |\n|---|---|---|---|---|---|---|"
TITLES = {
    "volume": "Volumes", "cameras": "Cameras and captures", "picture": "Pictures", "surface": "Surfaces",
    "scene": "Scenes", "lamps": "Lamps", "lens": "Lenses", "spectrum": "Spectra", "box": "Volume boxes",
    "reflectance": "Measured reflectances", "table": "Tables", "matter": "Our own text files", "result": "Results",
}  # fmt: skip


def on_files(files: Any, config: Any, **_: Any) -> Any:
    """Add the page of formats."""
    files.append(File.generated(config, PAGE, content=page()))
    return files


def page() -> str:
    """Markdown with a table per kind of content."""
    from hagoromo.files.format import formats

    parts = [HEAD]
    for holds, title in TITLES.items():
        rows = [_row(each) for each in formats() if each.holds == holds]
        if rows:
            parts += [f"## {title} {{ #{holds} }}", "\n".join([COLUMNS, *rows])]
    return "\n\n".join(parts) + "\n"


def _row(form: Any) -> str:
    shown = form.suffixes if len(form.suffixes) < 6 else (*form.suffixes[:5], "…")
    suffixes = " ".join(f"`{suffix}`" for suffix in shown if suffix) or "a folder"
    ways = ("yes" if form.reader else "", "yes" if form.writer or form.mesh_writer else "")
    cells = (form.name, suffixes, *ways, form.library, form.judge, form.lost)
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"
