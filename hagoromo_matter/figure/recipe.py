"""Kind "figure": a part of the angel (head, hands, feet, hair, robe, wings) or the nun (head, hands, hair, habit,
linen, veil), 0.27 m high.
"""

from __future__ import annotations

from typing import Annotated

from hagoromo.files.record import about, one_of
from hagoromo.matter.recipe import Kind, Recipe, RecipeTable
from hagoromo.reflectance.element import Element
from hagoromo.volume.store.plan import BoxPlan
from hagoromo_matter.figure.figure import FIGURE_PARTS, PART_MATERIALS, element_of, figure_part


class FigureTable(RecipeTable, frozen=True, kw_only=True):
    """A part of the angel or the nun, 0.27 m high."""

    figure: Annotated[str, one_of(*PART_MATERIALS), about("the figure")] = "angel"
    part: Annotated[str, one_of(*FIGURE_PARTS), about("the part of it")]


def _plan(recipe: Recipe[FigureTable]) -> BoxPlan:
    table = recipe.table
    return figure_part(table.figure, table.part, recipe.material, table.resolution, table.seed, table.extinction)


def _element(table: FigureTable) -> Element:
    return element_of(table.figure, table.part) if table.part in PART_MATERIALS[table.figure] else "cylinder"


KIND = Kind("", FigureTable, _plan, _element)
