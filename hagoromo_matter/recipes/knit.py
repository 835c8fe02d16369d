"""Kind "knit": stockinette: wales_per_cm, courses_per_cm, loop_mm, uneven: see `Knitted`; [yarn]: see `Yarn`.

How it lies: see `laid`; its face, with the legs of the loops in front, is the upper side. Element cylinder.
"""

from __future__ import annotations

from typing import Annotated, Any

from hagoromo.files.record import about, like
from hagoromo.matter.recipe import Kind, MeanFreePath, Recipe, Voxel
from hagoromo.volume.store.plan import BoxPlan
from hagoromo_matter.cloth.fabric import knitted
from hagoromo_matter.cloth.knit import Knitted, check_knitted
from hagoromo_matter.recipes.cloth import YarnTable, yarn_of
from hagoromo_matter.recipes.laid import LaidTable, laid

USUAL_KNIT = Knitted()


class KnitTable(LaidTable, frozen=True, kw_only=True):
    """A knitted cloth: stockinette."""

    voxel_mm: Voxel = 0.04
    mean_free_path_mm: MeanFreePath = 0.03
    wales_per_cm: Annotated[float, about("loops side by side [1/cm]")] = USUAL_KNIT.wales_per_cm
    courses_per_cm: Annotated[float, about("loops one above the other [1/cm]")] = USUAL_KNIT.courses_per_cm
    loop_mm: Annotated[float, about("yarn in a loop; 0: as dry relaxed wool of as many loops [mm]")] = (
        USUAL_KNIT.loop_mm
    )
    uneven: Annotated[float, about("standard deviation of the yarn's place, of its diameter")] = USUAL_KNIT.uneven
    yarn: Annotated[dict[str, Any], like(YarnTable), about("the yarn")] = {}


def _plan(recipe: Recipe[KnitTable]) -> BoxPlan:
    table, material = recipe.table, recipe.material
    fabric = knitted(_knitted(recipe), recipe.fineness.voxel_mm, max(table.variants, 1), table.seed)
    return laid(recipe, fabric, [material] * fabric.populations, "knit")


def _knitted(recipe: Recipe[KnitTable]) -> Knitted:
    """The cloth, its yarn and loops checked."""
    table, yarn = recipe.table, yarn_of(recipe.table.yarn, USUAL_KNIT.yarn, f"{recipe.where} [yarn]")
    return check_knitted(Knitted(table.wales_per_cm, table.courses_per_cm, yarn, table.loop_mm, table.uneven))


KIND = Kind("cylinder", KnitTable, _plan, check=_knitted)
