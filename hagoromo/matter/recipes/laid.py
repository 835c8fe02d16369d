"""Laid: how a cloth lies, and the plan of its box: a texel of its micro-structure on the sheets that it makes. In mm.

lay = "flat"      a patch, width_mm × height_mm, that stands on z = 0 and faces −y
lay = "hanging"   the same, gathered into folds: their number, and fold_depth_mm at the hem

carrier_mm: voxels of the lattice that says where the cloth is; variants: of the texel, so that its repeat is not seen.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from hagoromo.files.record import count, one_of, positive
from hagoromo.matter.fabric import Fabric
from hagoromo.matter.hanging import flat, hanging
from hagoromo.matter.recipes.recipe import Recipe, not_negative
from hagoromo.matter.sheet import Sheet
from hagoromo.matter.sheet_chart import sheet_chart
from hagoromo.matter.shell import shell
from hagoromo.matter.texture import texel
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.volume.plan import BoxPlan

LAID: dict[str, Any] = {
    "lay": (one_of("flat", "hanging"), "flat"), "width_mm": (positive, 30.0), "height_mm": (positive, 30.0),
    "folds": (count, 3), "fold_depth_mm": (not_negative, 7.0), "carrier_mm": (positive, 0.8), "variants": (count, 4),
}  # fmt: skip
MARGIN = 2.0  # voxels of the carrier around the cloth
HEM = 1.5  # voxels of the texel over which a hem fades


def laid(recipe: Recipe, fabric: Fabric, materials: Sequence[Reflectance], name: str) -> BoxPlan:
    """The plan of a box of `fabric` as the recipe lays it; one material per population."""
    voxel, carrier = recipe.fineness.voxel_mm, recipe["carrier_mm"]
    made = texel(
        fabric.field, fabric.period_mm, fabric.heights_mm, voxel, fabric.populations, max(recipe["variants"], 1)
    )
    reach = max(abs(height) for height in fabric.heights_mm) + MARGIN * carrier
    chart, bound, extent = sheet_chart(_sheets(recipe), reach, HEM * voxel, fabric.period_mm)
    path = recipe.fineness.mean_free_path_mm
    return shell(chart, bound, extent, carrier, made, path, materials, name=name)


def _sheets(recipe: Recipe) -> list[Sheet]:
    """The sheets that the cloth makes."""
    size = recipe["width_mm"], recipe["height_mm"]
    if recipe["lay"] == "hanging":
        return [hanging(size, recipe["folds"], recipe["fold_depth_mm"], recipe["seed"])]
    return [flat(size)]
