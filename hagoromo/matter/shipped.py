"""Shipped recipes: those that come with the package, each called by its name, such as linen."""

from __future__ import annotations

import re
from pathlib import Path

from hagoromo.errors import InputError

NAME = re.compile(r"[a-z][a-z0-9_]*")


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
