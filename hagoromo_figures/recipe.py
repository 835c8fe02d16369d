"""Kind "figure": a part of the angel (head, hands, feet, hair, robe, wings) or the nun (head, hands, hair, habit,
linen, veil), 0.27 m high.
"""

from __future__ import annotations

from hagoromo.files.record import one_of
from hagoromo.matter.recipes.recipe import Kind, Recipe
from hagoromo.volume.store.plan import BoxPlan
from hagoromo_figures.figure.figure import FIGURES, PARTS, element_of, figure_part


def _plan(recipe: Recipe) -> BoxPlan:
    return figure_part(recipe["figure"], recipe["part"], recipe.material, recipe["resolution"], recipe["seed"])


def _element(key: dict[str, object]) -> str:
    name, part = str(key["figure"]), str(key["part"])
    return element_of(name, part) if part in FIGURES[name] else "cylinder"


KIND = Kind("", {"figure": (one_of(*FIGURES), "angel"), "part": one_of(*PARTS)}, _plan, _element)
