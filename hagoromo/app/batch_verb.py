"""The command `hagoromo batch`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

import hagoromo as hg
from hagoromo.app.progress_bar import progress_bar
from hagoromo.app.shared_options import HERE, Scheduler
from hagoromo.app.verb import Force, say, verb, verbs, wrote
from hagoromo.errors import InputError

DONE, SOME_FAILED = 0, 2


@verb(verbs)
def batch(
    recipe: Positional[Path | None] = None,
    out: Annotated[Path | None, arg(help="folder of the results")] = None,
    new: Path | None = None,
    scheduler: Scheduler = HERE,
    dry_run: bool = False,
    force: Force = False,
) -> int:
    """Commands over many captures, scenes or recipes; what did not change since the last run is not done again.

    Exit status 2: some steps failed, a line names each with what it said; the others are done.

    Args:
        recipe: batch TOML: its steps, and the captures that they are repeated for.
        new: write FOLDER/batch.toml instead, a commented recipe for the objects in the folders of FOLDER: captures, and
            photographs with the lamps in an .lp there or in FOLDER, or with a chrome ball.
        dry_run: only say what would be done.
    """
    from hagoromo.app.batch.table import summary, table

    if new is not None:
        return _new_batch(new, [name for name, given in (("RECIPE", recipe), ("--out", out)) if given], force)
    if recipe is None or out is None:
        raise InputError("batch needs RECIPE.toml and --out FOLDER, or --new FOLDER, which writes a recipe")
    with progress_bar("batch") as progress:
        outcomes = hg.batch(recipe, out, scheduler=scheduler.chosen, dry_run=dry_run, force=force, progress=progress)
    say(*table(outcomes, dry_run), summary(outcomes, dry_run))
    failed = not dry_run and any(outcome.state in ("failed", "not run") for outcome in outcomes)
    return SOME_FAILED if failed else DONE


def _new_batch(folder: Path, spare: Sequence[str], force: bool) -> int:
    """Write the recipe of `batch --new`, and say what is in it."""
    from hagoromo.app.batch.new_recipe import new_recipe

    if spare:
        raise InputError(f"--new writes a recipe and runs nothing: omit {' and '.join(spare)}")
    recipe, shelf = new_recipe(folder, force)
    for steps, names in shelf.objects.items():
        said = "captures" if steps.captured else f"photographs, lamps {steps.said}"
        say(f"{said}: {', '.join(names)}")
    say(*(f"left out: {name}: {reason}" for name, reason in shelf.left_out.items()))
    wrote(recipe)
    return DONE
