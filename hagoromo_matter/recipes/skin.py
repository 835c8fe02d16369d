"""Kind "skin": the keys of `Granules` and `Lines`; size_mm of a patch, or [shape]; element sphere."""

from __future__ import annotations

from typing import Annotated, Any

from hagoromo.files.record import Positive, about, extended, like
from hagoromo.matter.recipe import Kind, MeanFreePath, Recipe, RecipeTable, Voxel
from hagoromo.volume.store.plan import BoxPlan
from hagoromo_matter.recipes.form import FORMS, shape_of
from hagoromo_matter.skin.skin import Granules, check_granules, skin_on, skin_patch


class SkinPlace(RecipeTable, frozen=True, kw_only=True):
    """A patch of skin, or skin on a shape."""

    size_mm: Annotated[Positive, about("edge of the square patch [mm]")] = 10.0
    shape: Annotated[dict[str, Any] | None, like(*FORMS), about("shape that is covered with skin")] = None
    voxel_mm: Voxel = 0.02
    mean_free_path_mm: MeanFreePath = 0.04


SkinTable = extended("SkinTable", SkinPlace, Granules)


def _plan(recipe: Recipe[Any]) -> BoxPlan:
    table, fine = recipe.table, recipe.fineness
    granules = check_granules(Granules(*(getattr(table, name) for name in Granules._fields)))
    if table.shape is None:
        return skin_patch(recipe.material, table.size_mm, granules, fine, table.seed)
    shape, extent = shape_of(table.shape, f"{recipe.where} [shape]", recipe.file, fine.voxel_mm)
    return skin_on(shape, extent, recipe.material, granules, fine, table.seed, name="skin")


KIND = Kind("sphere", SkinTable, _plan)
