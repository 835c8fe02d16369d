"""Kind "feather": a single feather that stands on its quill, or a patch of its vane.

    type = "primary" | "secondary" | "covert" | "contour" | "down": what is usual, where the tables leave it out
    [plume] form and shaft, [barbs], [barbules], [down], [marking] of a second colour: see `Feather` and its records
    after: length of its afterfeather as a share of its own
    patch_mm = [across, along], middle_mm = [across, along]: only a patch of the vane, laid flat
    [marking_material], [shaft_material]: keys of [material] that markings and shaft have in its place

Element cylinder.
"""

from __future__ import annotations

from typing import Any

from hagoromo.files.record import count, number, numbers, one_of, positive, table, take
from hagoromo.matter.feather.feather import FEATHER_FINENESS, PATCH_FINENESS, feather, vane_patch
from hagoromo.matter.feather.kinds import FEATHERS
from hagoromo.matter.feather.marking import PATTERNS
from hagoromo.matter.feather.vane import Feather
from hagoromo.matter.recipes.recipe import Kind, Recipe, with_defaults
from hagoromo.volume.store.plan import BoxPlan

TABLES = "plume", "barbs", "barbules", "down", "marking"
SPECIAL = {"hooks": count, "pattern": one_of(*PATTERNS)}  # what is no plain number


def _plan(recipe: Recipe) -> BoxPlan:
    usual, patch = FEATHERS[recipe["type"]], recipe["patch_mm"]
    parts = {name: _part(recipe, name, getattr(usual, name)) for name in TABLES}
    made = Feather(**parts, after=usual.after if recipe["after"] is None else recipe["after"])
    fine = PATCH_FINENESS if patch else FEATHER_FINENESS
    fine = fine._replace(**{k: recipe[k] for k in ("voxel_mm", "mean_free_path_mm") if recipe[k]})
    fine = fine.finer(recipe["resolution"])
    materials = [recipe.material, *(recipe.varied(name) for name in ("marking_material", "shaft_material"))]
    if patch:
        return vane_patch(materials, made, patch, recipe["middle_mm"], fine, recipe["seed"])
    return feather(materials, made, fine, recipe["seed"])


def _part(recipe: Recipe, name: str, usual: Any) -> Any:
    keys = take(recipe[name], with_defaults(usual, SPECIAL, number), f"{recipe.where} [{name}]")
    return type(usual)(**keys)


KEYS = {
    "type": (one_of(*FEATHERS), "primary"), **dict.fromkeys(TABLES, (table, {})), "after": (number, None),
    "patch_mm": (numbers(2), None), "middle_mm": (numbers(2), (4.0, 55.0)), "marking_material": (table, {}),
    "shaft_material": (table, {}), "voxel_mm": (positive, None), "mean_free_path_mm": (positive, None),
}  # fmt: skip
KIND = Kind("cylinder", KEYS, _plan)
