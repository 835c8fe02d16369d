"""Parts of a box on many workers: each fills blocks of a recipe's box and writes them into the folder of the box.

A block is a chunk of its own in every array, so that no two workers write one file; a block that is written twice,
because a worker died, has the same bytes. The folder must be one that all workers see.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from hagoromo.cluster.cluster import workers_of
from hagoromo.errors import InputError
from hagoromo.files.content import content_with_named
from hagoromo.matter.planned import planned
from hagoromo.matter.shipped import recipe_place
from hagoromo.progress import Progress
from hagoromo.volume.store.build_store import Bricks, build_box, group_of, write_part
from hagoromo.volume.store.plan import BoxPlan


def build_on(
    scheduler: str | int,
    recipe: Mapping[str, Any] | str | Path,
    plan: BoxPlan,
    path: str | Path,
    fingerprint: str,
    force: bool,
    progress: Progress,
) -> None:
    """`build_box` whose parts are built by the workers of `scheduler`, see `workers_of`."""
    if not isinstance(recipe, (str, Path)):
        raise InputError("a scheduler builds the recipe of a file, which its workers read: give the path of one")
    file = str(recipe_place(recipe).absolute())
    digest = content_with_named(file, quick=True)
    with workers_of(scheduler) as cluster:

        def elsewhere(folder: Path, numbers: list[int]) -> Iterator[tuple[int, Bricks]]:
            tasks = ((file, digest, str(folder), number) for number in numbers)
            for task, bricks in cluster.results(build_part, tasks):
                yield numbers[task], bricks

        build_box(plan, path, fingerprint, force, progress, elsewhere)


_held: dict[tuple[str, str], BoxPlan] = {}  # the plan of the recipe that this worker builds


def build_part(recipe: str, digest: str, folder: str, number: int) -> Bricks:
    """On a worker: write the blocks of a part of a recipe's box into the folder where the box is built."""
    if (recipe, digest) not in _held:
        _held.clear()
        if content_with_named(recipe, quick=True) != digest:
            raise InputError(
                f"{recipe}, or a file that it names, is another one on a worker: put them where all find the same"
            )
        _held[recipe, digest] = planned(recipe)[0]
    if not Path(folder).is_dir():
        raise InputError(f"a worker does not see {folder}: write to a folder that all workers share")
    plan = _held[recipe, digest]
    return write_part(plan, group_of(plan, Path(folder), begun=True), number)
