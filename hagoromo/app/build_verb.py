"""The command `hagoromo build`."""

from __future__ import annotations

from pathlib import Path

from tyro.conf import Positional, UseAppendAction

import hagoromo as hg
from hagoromo.app.progress_bar import progress_bar
from hagoromo.app.shared_options import HERE, Scheduler
from hagoromo.app.verb import Force, Out, say, wrote
from hagoromo.errors import InputError
from hagoromo.files.whole import replaceable_file, replaceable_folder


def build(
    recipe: Positional[Path],
    out: Out,
    vary: UseAppendAction[tuple[str, ...]] = (),
    across_mm: float | None = None,
    cell: int | None = None,
    scheduler: Scheduler = HERE,
    force: Force = False,
) -> None:
    """Recipe of matter (shape, micro-structure, material) → volume box, which may be larger than the memory.

    The same command resumes a build that was interrupted or stopped because the disk was full. With --vary: a contact
    sheet (PNG) of the recipe with other values, under one lamp, by one camera, of one seed.

    Args:
        recipe: matter TOML, or the name of one that comes with Hagoromo (`hagoromo recipes` lists them).
        vary: KEY=VALUE,VALUE of the recipe, such as warp.twist_per_cm=2,6: one key or two with several values, and any
            with one value, such as resolution=0.5.
        across_mm: width of what each cell of the sheet shows, in the middle [mm] (default: all of the largest box).
        cell: side of a cell of the sheet [px] (default: 320).
    """
    if vary:
        return _write_sheet(recipe, out, vary, across_mm, cell, scheduler.chosen is not None, force)
    if across_mm is not None or cell is not None:
        raise InputError("--across-mm and --cell are of a contact sheet: give --vary, too, or leave them out")
    replaceable_folder(out, force)  # before all that builds is imported
    from hagoromo.volume.store.box_store import look_at_box

    with progress_bar("build") as progress:
        hg.build_to(recipe, out, force, progress, scheduler.chosen)
    say(*str(look_at_box(out)).splitlines())
    wrote(out)


def _write_sheet(
    recipe: Path, out: Path, vary: tuple[str, ...], across_mm: float | None, cell: int | None, sent: bool, force: bool
) -> None:
    from hagoromo.image.recipe_sheet import CELL_PX, checked_png, recipe_sheet, varied_keys

    if sent:
        raise InputError("the boxes of a contact sheet are built here: leave --scheduler out")
    replaceable_file(checked_png(out), force)
    keys, across = varied_keys(vary), None if across_mm is None else 1e-3 * across_mm
    with progress_bar("build") as progress:
        sheet = recipe_sheet(recipe, keys, across, CELL_PX if cell is None else cell, progress)
    wrote(sheet.save(out, force))
