"""The scenes that are shown by all three modes: the gallery's recipes, each whole, and figures 6, 7 and 8."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import hagoromo as hg
from hagoromo_matter.demo.figures import PAPER_FIGURES, Cast
from hagoromo_matter.demo.measured import reflectances_of
from hagoromo_matter.demo.samples import FOCAL_MM, PRESET
from hagoromo_matter.demo.size import SIZES
from studies.gallery.gallery_item import changed, of_whole
from studies.gallery.gallery_items import ITEMS
from studies.gallery.gallery_view import whole_scene

PIXELS = {"gallery": 128, "figure": 192}  # on the longer side of a picture
ORDER = (  # the lightest first
    "skin", "linen", "primary", "figure_6_wing", "figure_7_hair", "figure_7_skin", "figure_6_drape", "figure_8_whole",
    "linen_through", "primary_through", "down", "covert", "satin", "jacquard", "twill", "herringbone", "stockinette",
    "wing", "hair", "scan", "cloth_10_cm", "figure_8_angel", "figure_8_nun",
)  # fmt: skip


class SceneFolders(NamedTuple):
    """Folders: of a demo, whose measured materials the figures have; of the recipes; of the data, with the scan."""

    demo: Path
    recipes: Path
    data: Path


def title_of(name: str) -> str:
    """What a scene shows."""
    if name in ITEMS:
        return ITEMS[name].title
    return f"Figure {name.split('_')[1]}. {PAPER_FIGURES[name].caption.split(';')[0].rstrip('.')}"


def scene_of(name: str, sources: SceneFolders) -> hg.Scene:
    """The scene of one of ORDER, its boxes of projected extinction."""
    if name in ITEMS:
        item = ITEMS[name]
        record = changed(sources.recipes, item, of_whole(item, sources.data) | {"extinction": "projected"})
        return whole_scene(hg.build(record), PIXELS["gallery"])
    size = SIZES[hg.read_json(sources.demo / "results.json")["size"]["name"]]
    found = reflectances_of(hg.read_materials(sources.demo / "measure" / "materials.json"), size)
    cast = Cast(found, size.resolution, size.seed, size.without, "projected")
    camera = hg.Camera.preset(PRESET, FOCAL_MM, size.figure_binning).limited(PIXELS["figure"])
    return cast.scene(name, camera, hg.silent)
