"""Kind "wing": the pair of wings of a figure 270 mm high, from primaries, secondaries and coverts to down.

[flight_material], [shaft_material]: keys of [material] that flight feathers and shafts have in its place. resolution:
of voxels of 0.2 mm. Element cylinder.
"""

from __future__ import annotations

from typing import Annotated, Any

from hagoromo.files.record import about
from hagoromo.matter.recipe import Kind, Recipe, RecipeTable
from hagoromo.reflectance.material.material_table import PARTS
from hagoromo.volume.store.plan import BoxPlan
from hagoromo_matter.feather.wing import wing_of


class WingTable(RecipeTable, frozen=True, kw_only=True):
    """The pair of wings of a figure 270 mm high."""

    flight_material: Annotated[dict[str, Any], PARTS, about("what flight feathers have in place of [material]")] = {}
    shaft_material: Annotated[dict[str, Any], PARTS, about("what shafts have in place of [material]")] = {}


def _plan(recipe: Recipe[WingTable]) -> BoxPlan:
    materials = [recipe.material, *(recipe.varied(name) for name in ("flight_material", "shaft_material"))]
    return wing_of(materials, recipe.table.resolution, recipe.table.seed)


KIND = Kind("cylinder", WingTable, _plan)
