"""Kind "feather": the keys of `Plume`; element cylinder."""

from __future__ import annotations

from hagoromo.files.record import number
from hagoromo.matter.feather import feather
from hagoromo.matter.plume import Plume
from hagoromo.matter.recipes.recipe import Kind, Recipe, fineness_keys, share, with_defaults
from hagoromo.matter.vane import Feather
from hagoromo.volume.plan import BoxPlan


def _plan(recipe: Recipe) -> BoxPlan:
    return feather(recipe.material, Feather(recipe.record(Plume)), recipe.fineness, recipe["seed"])


KIND = Kind("cylinder", with_defaults(Plume(), {"quill": share, "bow_mm": number}) | fineness_keys(0.12, 0.12), _plan)
