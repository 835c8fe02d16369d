"""Kind "skin": the keys of `Granules` and `Lines`; size_mm of a patch, or [shape]; element sphere."""

from __future__ import annotations

from hagoromo.files.record import positive, table
from hagoromo.matter.recipes.form import shape_of
from hagoromo.matter.recipes.recipe import Kind, Recipe, fineness_keys, not_negative, with_defaults
from hagoromo.matter.skin.skin import Granules, check_granules, skin_on, skin_patch
from hagoromo.volume.store.plan import BoxPlan

FROM_0 = "corneum_mm", "scale_deg", "primary_depth_mm", "secondary_depth_mm", "pores_per_cm2", "fade_mm"


def _plan(recipe: Recipe) -> BoxPlan:
    granules, fine, seed = check_granules(recipe.record(Granules)), recipe.fineness, recipe["seed"]
    if recipe["shape"] is None:
        return skin_patch(recipe.material, recipe["size_mm"], granules, fine, seed)
    shape, extent = shape_of(recipe["shape"], f"{recipe.where} [shape]")
    return skin_on(shape, extent, recipe.material, granules, fine, seed, name="skin")


KEYS = {"size_mm": (positive, 10.0), "shape": (table, None)}
KIND = Kind(
    "sphere",
    KEYS | with_defaults(Granules(), dict.fromkeys(FROM_0, not_negative)) | fineness_keys(0.02, 0.04),
    _plan,
)
