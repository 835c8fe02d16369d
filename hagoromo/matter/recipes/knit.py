"""Kind "knit": stockinette: wales_per_cm, courses_per_cm, loop_mm, uneven: see `Knitted`; [yarn]: see `Yarn`.

How it lies: see `laid`; its face, with the legs of the loops in front, is the upper side. Element cylinder.
"""

from __future__ import annotations

from hagoromo.files.record import number, table
from hagoromo.matter.cloth.fabric import knitted
from hagoromo.matter.cloth.knit import Knitted
from hagoromo.matter.recipes.cloth import yarn_of
from hagoromo.matter.recipes.laid import LAID, laid
from hagoromo.matter.recipes.recipe import Kind, Recipe, fineness_keys
from hagoromo.volume.store.plan import BoxPlan

USUAL = Knitted()
NUMBERS = "wales_per_cm", "courses_per_cm", "loop_mm", "uneven"


def _plan(recipe: Recipe) -> BoxPlan:
    cloth = Knitted(yarn=yarn_of(recipe, "yarn", USUAL.yarn), **{name: recipe[name] for name in NUMBERS})
    material = recipe.material
    fabric = knitted(cloth, recipe.fineness.voxel_mm, max(recipe["variants"], 1), recipe["seed"])
    return laid(recipe, fabric, [material] * fabric.populations, "knit")


KEYS = {"yarn": (table, {}), **{name: (number, getattr(USUAL, name)) for name in NUMBERS}}
KIND = Kind("cylinder", KEYS | LAID | fineness_keys(0.04, 0.03), _plan)
