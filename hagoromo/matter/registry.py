"""Registry: the kinds of matter that recipes may name, the recipes that ship, and the plan of the box of a recipe.

A package adds a kind by the name of the kind, and where its `Kind` is; those of `hagoromo_matter` are added so, too.

    [project.entry-points."hagoromo.matter"]
    lichen = "my_package.lichen:KIND"
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

from hagoromo.errors import InputError, described
from hagoromo.files.record import ForeignRecord, decode, read_toml
from hagoromo.matter.recipe import Kind, Recipe
from hagoromo.volume.store.plan import BoxPlan

GROUP = "hagoromo.matter"
NAME = re.compile(r"[a-z][a-z0-9_]*")


@cache
def kind_names() -> tuple[str, ...]:
    """The names of all kinds, in the order of the alphabet; no package that has them is imported."""
    return tuple(sorted(entry_points(group=GROUP).names))


def kind_of(name: str) -> Kind:
    """The kind of matter called `name`, one of `kind_names()`.

    `InputError` when the package that names it cannot be imported, or holds no `Kind` there.
    """
    (point, *_) = entry_points(group=GROUP, name=name)
    try:
        kind = point.load()
    except (ImportError, AttributeError) as error:
        raise InputError(f"the kind of matter {name!r} ({point.value}) cannot be loaded: {error}") from error
    if not isinstance(kind, Kind):
        raise InputError(f"the kind of matter {name!r} ({point.value}) is a {type(kind).__name__}: it must be a Kind")
    return kind


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


def shipped_recipes() -> dict[str, Path]:
    """Name → file of every recipe that comes with the package, by name.

    They are `examples/recipes` of the repository, which the wheel holds as `hagoromo/matter/recipes`.
    """
    installed = Path(__file__).parent / "recipes"
    folder = installed if installed.is_dir() else Path(__file__).parents[2] / "examples" / "recipes"
    return {file.stem: file for file in sorted(folder.glob("*.toml"))}


def recipe_place(recipe: str | Path) -> Path:
    """The file of a recipe: a path, or where there is nothing at it the name of a recipe that comes with the package.

    `InputError`, with the names that there are, for a name of none.
    """
    path = Path(recipe)
    if not NAME.fullmatch(str(recipe)) or path.exists():
        return path
    known = shipped_recipes()
    if path.name not in known:
        raise InputError(f"{recipe} is neither a file nor a recipe that comes with Hagoromo: {', '.join(known)} are")
    return known[path.name]


def summary(recipe: Path) -> str:
    """What a recipe says of itself: its first comment, up to its first sentence's end."""
    for line in recipe.read_text(encoding="utf-8").splitlines():
        if line.startswith("# "):
            return re.split(r"\.\s|\.$|  ", line[2:])[0]
    return ""
