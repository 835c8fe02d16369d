"""The command `hagoromo recipes`."""

from __future__ import annotations

from hagoromo.app.verb import say, verb, verbs


@verb(verbs)
def recipes(name: str | None = None) -> None:
    """The recipes that come with Hagoromo, a line each; `hagoromo build linen` and scenes (recipe = "linen") take them.

    Args:
        name: print this recipe, to keep it as a file and change it.
    """
    from hagoromo.matter.recipe import recipe_place, shipped_recipes, summary

    if name is not None:
        say(*recipe_place(name).read_text(encoding="utf-8").splitlines())
        return
    known = shipped_recipes()
    width = max(map(len, known))
    say(*(f"{name:{width}}  {summary(file)}" for name, file in known.items()))
