"""Gallery page: docs/gallery.md from the pictures and the figures of the items."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import hagoromo as hg
from studies.gallery.gallery_items import ITEMS

GALLERY_INTRODUCTION = """# Gallery

Every picture here is made by `python -m studies gallery` from the recipes in [`{recipes}`](../{recipes}),
which `hagoromo build` builds, too. Of each matter: all of it; a field of view of 1 cm, of a woven cloth beside its
draft of 1 cm (dark: the warp is on the face); one of 1 mm; and all of it under one lamp that moves around it in steps
of 45°, from the front to its right, to behind it, and back. The same seed gives the same pictures.

"""
COST = """## What each costs

To build what the first picture shows, kernels compiled anew, on the machine that made this page ({machine}): by the
clock, and of all its cores together, which other work on the machine does not change. Peak: the most memory that the
process had held when the box was done, `hagoromo` and its libraries ({before} MiB before the build) included.

| matter | seconds | core seconds | peak MiB | bricks | texel MiB | voxel mm | lattice |
|---|---:|---:|---:|---:|---:|---:|---|
"""
VIEW_TITLES = {"whole": "whole", "10_mm": "1 cm", "draft": "draft of 1 cm", "1_mm": "1 mm"}


def write_page(path: Path, recipes: Path, costs: Mapping[str, Mapping[str, Any]]) -> None:
    """Write the page: items whose pictures are there, and the `costs` that are known."""
    parts = [GALLERY_INTRODUCTION.format(recipes=recipes.as_posix())]
    made = [name for name in ITEMS if (path.parent / "figures" / "gallery" / f"{name}_whole.jpg").exists()]
    parts += [_shown(path, recipes, name) for name in made]
    parts += [_table(costs)] if costs else []
    with hg.whole_file(path, force=True) as partial:
        partial.write_text("".join(parts), encoding="utf-8", newline="\n")


def _shown(path: Path, recipes: Path, name: str) -> str:
    """The pictures of one item."""
    item, folder = ITEMS[name], path.parent / "figures" / "gallery"
    present = [(view, title) for view, title in VIEW_TITLES.items() if (folder / f"{name}_{view}.jpg").exists()]
    width = 32 if len(present) <= 3 else 24
    row = " ".join(
        f'<img src="figures/gallery/{name}_{view}.jpg" width="{width}%" alt="{item.title}, {title}">'
        for view, title in present
    )
    strip = f'<img src="figures/gallery/{name}_lamps.jpg" width="97%" alt="{item.title} under a lamp that moves">'
    return (
        f"## {item.title}\n\n[`{item.recipe}.toml`](../{recipes.as_posix()}/{item.recipe}.toml)\n\n{row}\n\n{strip}\n\n"
    )


def _table(costs: Mapping[str, Mapping[str, Any]]) -> str:
    rows = []
    for name, cost in costs.items():
        lattice, texel = " × ".join(map(str, cost["voxels"])), cost.get("texel_mib", "")
        cells = [ITEMS[name].title, *(cost[key] for key in ("seconds", "core_seconds", "peak_mib", "bricks"))]
        rows.append(f"| {' | '.join(map(str, [*cells, texel, cost['voxel_mm'], lattice]))} |")
    before = max(cost["before_mib"] for cost in costs.values())
    machine = next(iter(costs.values())).get("machine", "")
    return COST.format(machine=machine, before=before) + "\n".join(rows) + "\n"
