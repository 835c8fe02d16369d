"""Kind "cloth": the keys of `Weave`; width_mm, height_mm, folds, fold_depth_mm (0: flat) of a patch, or [shape]."""

from __future__ import annotations

from typing import Any

import drjit as dr

from hagoromo.backend import arrays
from hagoromo.files.record import count, positive, table
from hagoromo.matter.cloth import Weave, check_weave, covering
from hagoromo.matter.drape import drape_patch
from hagoromo.matter.fill import fill
from hagoromo.matter.recipes.form import shape_of
from hagoromo.matter.recipes.recipe import Kind, Recipe, fineness_keys, not_negative, share, with_defaults
from hagoromo.volume.plan import BoxPlan


def _plan(recipe: Recipe) -> BoxPlan:
    weave, fine, seed = check_weave(recipe.record(Weave)), recipe.fineness, recipe["seed"]
    if recipe["shape"] is None:
        size = (recipe["width_mm"], recipe["height_mm"])
        return drape_patch(recipe.material, size, weave, (max(recipe["folds"], 1), recipe["fold_depth_mm"]), fine, seed)
    shape, extent = shape_of(recipe["shape"], f"{recipe.where} [shape]")
    around = 0.5 * (extent[1][0] - extent[0][0])

    def chart(point: Any) -> tuple[Any, Any, Any]:
        return dr.atan2(point.x, -point.y) * around, point.z, arrays().Array3f(0, 0, 1)

    def field(point: Any) -> tuple[Any, Any]:
        return covering(point, shape, chart, weave, fine, seed)

    return fill(field, fine.layer(shape, 0.5 * weave.diameter_mm), extent, fine, recipe.material, name="cloth")


KEYS = {
    "width_mm": (positive, 60.0), "height_mm": (positive, 70.0), "folds": (count, 3),
    "fold_depth_mm": (not_negative, 7.0), "shape": (table, None),
}  # fmt: skip
KIND = Kind(
    "cylinder",
    KEYS | with_defaults(Weave(), {"crimp": not_negative, "uneven": share}) | fineness_keys(0.12, 0.2),
    _plan,
)
