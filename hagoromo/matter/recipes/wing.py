"""Kind "wing": the pair of wings of a figure 270 mm high, from primaries, secondaries and coverts to down.

[flight_material], [shaft_material]: keys of [material] that flight feathers and shafts have in its place. resolution:
of voxels of 0.2 mm. Element cylinder.
"""

from __future__ import annotations

from hagoromo.files.record import table
from hagoromo.matter.feather.wing import wing_of
from hagoromo.matter.recipes.recipe import Kind, Recipe
from hagoromo.volume.store.plan import BoxPlan


def _plan(recipe: Recipe) -> BoxPlan:
    materials = [recipe.material, *(recipe.varied(name) for name in ("flight_material", "shaft_material"))]
    return wing_of(materials, recipe["resolution"], recipe["seed"])


KIND = Kind("cylinder", {"flight_material": (table, {}), "shaft_material": (table, {})}, _plan)
