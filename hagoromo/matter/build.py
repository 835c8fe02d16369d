"""Build: a recipe (MATTER.toml, or the same as a dictionary) → VolumeBox that stands on z = 0 and faces −y.

The box is built in memory, or straight to disk, where it may be larger than the memory. Each file of `matter.recipes`
documents the keys of one kind of matter. Keys of all kinds: [material]; name; seed (whole number); resolution (1: as
stated; 2: voxels half as large); extinction ("isotropic" or "projected", see `VolumeBox`); except for the figure, also
voxel_mm and mean_free_path_mm (of light where the density is 1: matter several times as thick is opaque; with projected
extinction it is divided by the projected area of the elements). Paths are relative to the folder of the recipe.

[material] is {alpha, beta, gamma [rad], nu, n, body_colour, interface_colour, element, name} or a measured one:
{file = "materials.json", material = "name", element, response, lamp}. Without `element` it is the kind's.

Parts of a box on many workers: each fills blocks of a recipe's box and writes them into the folder of the box.

A block is a chunk of its own in every array, so that no two workers write one file; a block that is written twice,
because a worker died, has the same bytes. The folder must be one that all workers see.
"""

from __future__ import annotations

import json
import logging
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from hagoromo import backend
from hagoromo.cluster.cluster import workers_of
from hagoromo.errors import InputError, described
from hagoromo.files.cache import cache
from hagoromo.files.checks import inside
from hagoromo.files.content import content_with_named
from hagoromo.files.whole import replaceable_folder
from hagoromo.matter.recipe import planned, recipe_place
from hagoromo.progress import Progress, silent
from hagoromo.version import __version__
from hagoromo.volume.box import VolumeBox
from hagoromo.volume.store.box_store import load_box, save_box
from hagoromo.volume.store.build_store import Bricks, build_box, group_of, write_part
from hagoromo.volume.store.plan import BoxPlan

LOG = logging.getLogger(__name__)
BOX = "box.zarr"  # in an entry of the cache


def build(recipe: Mapping[str, Any] | str | Path, progress: Progress = silent, folder: Path | None = None) -> VolumeBox:
    """The volume box of a recipe: the path of a TOML file, the name of a shipped one, or its tables.

    The head of this module says the keys. folder: where the files lie that a recipe given by its tables names.

    Raises `InputError` that names the wrong key, or an unknown key together with the known ones.

    >>> material = {"alpha": 0.2, "beta": 0.1, "gamma": 0.2, "n": 1.5, "body_colour": 0.8}
    >>> shape = {"form": "sphere", "radius_mm": 2.0}
    >>> box = hg.build({"kind": "solid", "shape": shape, "voxel_mm": 0.5, "material": material})
    >>> volume = box.bricks.dense()[0].astype(float).sum() * 0.5**3  # mm³, of a ball of 4/3 π 2³ = 33.5
    >>> bool(abs(volume / 33.5 - 1) < 0.1)  # a soft edge of a voxel enlarges it
    True
    """
    plan, where, _ = planned(recipe, folder)
    progress(0.0)
    LOG.info("building %s in memory", where)
    with described(where):
        box = plan.box()
    LOG.info("%s is built", where)
    progress(1.0)
    return box


def build_to(
    recipe: Mapping[str, Any] | str | Path,
    path: str | Path,
    force: bool = False,
    progress: Progress = silent,
    scheduler: str | int | None = None,
) -> None:
    """Build the box of a recipe at `path`, block by block. Memory holds one block; an interrupted build is resumed.

    scheduler: see `render`; workers fill the blocks of a recipe file, and write them where `path` is, which all must
    see. The bits are the same. Raises what `build` and `resumable_folder` raise.
    """
    replaceable_folder(path, force)  # before any work
    plan, where, folder = planned(recipe)
    with described(where):
        known = fingerprint(plan.header.provenance["recipe"], folder)
    LOG.info("building %s at %s", where, path)
    if scheduler is None:
        build_box(plan, path, known, force, progress)
        return
    build_on(scheduler, recipe, plan, path, known, force, progress)


def fingerprint(record: Mapping[str, Any], folder: Path | None) -> str:
    """JSON of the recipe with its seed, of the state of the files in `folder` that it names, of version and backend.

    The state of a file is its size and its time of last change. Raises `InputError` for values that JSON cannot hold.
    """
    named = {text: _state(folder, text) for text in sorted(set(_texts(record)))}
    files = {text: state for text, state in named.items() if state}
    known = {"recipe": record, "files": files, "version": __version__, "backend": backend.name()}
    try:
        return json.dumps(known, sort_keys=True)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"a box on disk needs a recipe of plain values: {error}") from error


def _texts(value: Any) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, (dict, list)):
        for entry in value.values() if isinstance(value, dict) else value:
            yield from _texts(entry)


def _state(folder: Path | None, text: str) -> list[Any]:
    """Path, size and time of the file `text`, or of all files in that folder; empty where neither exists."""
    try:
        path = Path(text) if folder is None else inside(folder, text)
        paths = [path] if path.is_file() else sorted(inner for inner in path.rglob("*") if inner.is_file())
    except (InputError, OSError, ValueError):
        return []  # the text is not a path
    return [[p.relative_to(path).as_posix(), p.stat().st_size, p.stat().st_mtime_ns] for p in paths]


def kept_box(depends_on: Any, make: Callable[[], VolumeBox]) -> VolumeBox:
    """The box that `make` gives, or the same one from the cache. depends_on: plain data, all that it depends on."""
    return cache().kept(
        ["box", depends_on],
        lambda folder: load_box(folder / BOX),
        make,
        lambda box, folder: save_box(box, folder / BOX),
    )


def built_box(recipe: Path) -> VolumeBox:
    """`build` of a recipe file, once for each content of it and of the files that it names."""
    return kept_box(content_with_named(recipe), lambda: build(recipe))


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
