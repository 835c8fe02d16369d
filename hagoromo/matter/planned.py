"""The plan of a box of a recipe: its file or tables, read, checked and given to the kind of matter that it names."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hagoromo.errors import InputError, described
from hagoromo.files.record import ForeignRecord, decode, read_toml
from hagoromo.matter.recipe import Recipe
from hagoromo.matter.registry import kind_names, kind_of
from hagoromo.matter.shipped import recipe_place
from hagoromo.volume.store.plan import BoxPlan


def planned(recipe: Mapping[str, Any] | str | Path) -> tuple[BoxPlan, str, Path | None]:
    """The plan of a recipe's box; what messages call the recipe; the folder of the files that it names."""
    if isinstance(recipe, (str, Path)):
        recipe = recipe_place(recipe)
        record, where, folder = read_toml(recipe), str(recipe), recipe.parent
    else:
        record, where, folder = dict(recipe), "recipe", None
    name = decode(record, _OfKind, where).kind
    if name not in kind_names():
        raise InputError(f"{where}: kind must be one of {', '.join(kind_names())}: given {name!r:.60}")
    kind = kind_of(name)
    table = decode(record, kind.record, where)
    element = kind.element_of(table) if kind.element_of else kind.element or "plane"
    with described(where):
        plan = kind.plan(Recipe(table, element, folder, where)).with_extinction(table.extinction)
    return plan.named(table.name, {"recipe": record}), where, folder


class _OfKind(ForeignRecord, frozen=True):
    kind: str
