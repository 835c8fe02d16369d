"""The page of the parameters of a reflectance, written from the table that records, fits and exports go by."""

from __future__ import annotations

import math
from typing import Any

from mkdocs.structure.files import File

PAGE = "reference/parameters.md"
HEAD = """# Parameters of a reflectance

What a reflectance consists of: its name in files and in Python, its symbol in
[the model](../model/reflection.md), its unit and the range that is admissible. A fit moves a coordinate of it, in a
range of its own. The last column says where it may differ from place to place: in the maps of a measurement, by
textures of a surface in a scene, by textures of our BSDF in Mitsuba, in the voxels of a box. This page is written from
the table in the code, `hagoromo/reflectance/parameters.py`.
"""
LOSSES = """## What formats lose { #lost }

What is written for other programs names, for each material, which of these it loses. A value that has no effect is
not lost: where there is no gloss, its width is not missed.
"""
COLUMNS = (
    ("name", "symbol", "unit", "meaning", "range", "coordinate of a fit", "range of a fit", "varies in"),
    ("name", "lost in", "in its place"),
)


def on_files(files: Any, config: Any, **_: Any) -> Any:
    """Add the page of parameters."""
    files.append(File.generated(config, PAGE, content=page()))
    return files


def page() -> str:
    """Markdown with what each parameter is, and where it is lost."""
    from hagoromo.reflectance.parameters import PARAMETERS

    rows = [each for each in PARAMETERS if each.part != "evidence"]
    losses = [cells for each in rows for cells in _lost(each)]
    tables = (_table(COLUMNS[0], [_row(each) for each in rows]), _table(COLUMNS[1], losses))
    return "\n\n".join([HEAD, tables[0], LOSSES, tables[1]]) + "\n"


def _row(row: Any) -> tuple[str, ...]:
    fit = ("", "") if row.fitted is None else (row.fit.words, _range(row.fit.range))
    ends = "" if row.range is None else _range(row.range)
    return (f"`{row.name}`", row.symbol, row.unit, row.meaning, ends, *fit, ", ".join(row.varies))


def _range(ends: tuple[float, float]) -> str:
    low, high = ends
    return f"{low:.4g} and more" if math.isinf(high) else f"{low:.4g} … {high:.4g}"


def _lost(row: Any) -> list[tuple[str, ...]]:
    """A row for each thing that stands in the place of a parameter that is lost."""
    forms: dict[str, list[str]] = {}
    for form, instead in row.lost.items():
        forms.setdefault(instead, []).append(form)
    return [
        (f"`{row.name}`", ", ".join(found), instead.removesuffix(" stand instead")) for instead, found in forms.items()
    ]


def _table(titles: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    lines = [titles, ("---",) * len(titles), *rows]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in lines)
