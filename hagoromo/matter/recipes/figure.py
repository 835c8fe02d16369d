"""Kind "figure": part = "skin", "cloth" or "feather" of the winged, draped figure, 0.3 m high."""

from __future__ import annotations

from hagoromo.files.record import one_of
from hagoromo.matter.figure import PARTS, figure_part
from hagoromo.matter.recipes.recipe import Kind, Recipe
from hagoromo.volume.plan import BoxPlan

ELEMENTS = {"skin": "sphere", "cloth": "cylinder", "feather": "cylinder"}


def _plan(recipe: Recipe) -> BoxPlan:
    return figure_part(recipe["part"], recipe.material, recipe["resolution"], recipe["seed"])


KIND = Kind("", {"part": one_of(*PARTS)}, _plan, lambda key: ELEMENTS[key["part"]])
