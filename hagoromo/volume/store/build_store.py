"""Build a box straight to disk, block by block: memory follows a block, and what is done outlives an interruption."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from hagoromo.files.resumable import resumable_folder
from hagoromo.progress import Progress, part_of, silent
from hagoromo.volume.store.blocks import Block, filled, kept_bricks, matter_flags
from hagoromo.volume.store.box_group import BoxGroup
from hagoromo.volume.store.box_store import save_box
from hagoromo.volume.store.disk_budget import check_disk
from hagoromo.volume.store.packed_bricks import write_packed
from hagoromo.volume.store.plan import BoxPlan
from hagoromo.volume.store.zarr_blocks import in_order
from hagoromo.volume.table import BLOCK

BUILT = 0.7  # of the work, when all blocks are written and their bricks are to be packed
Bricks = tuple[NDArray[np.int64], NDArray[np.uint8]]  # places (n, 3) of bricks with matter, and their `matter_flags`
Elsewhere = Callable[[Path, list[int]], Iterator[tuple[int, Bricks]]]  # folder, numbers of parts → number, bricks


def build_box(
    plan: BoxPlan,
    path: str | Path,
    fingerprint: str,
    force: bool = False,
    progress: Progress = silent,
    elsewhere: Elsewhere | None = None,
) -> None:
    """Build the box of `plan` at `path`, whole or not at all.

    elsewhere: writes the blocks of parts in other processes, which see the same folder and have the same plan.

    fingerprint: text that differs for plans of different voxels; a run that was cut off is taken up again by the next
    one with the same, see `resumable_folder`, which also says what is raised, as does `check_disk`.
    """
    blocks = plan.blocks
    if plan.header.texel:  # small: built in memory
        save_box(plan.box(), path, force)
        return
    check_disk(plan, path)
    with resumable_folder(path, fingerprint, force) as folder:
        group = group_of(plan, folder)
        done = folder.parent / "done"
        done.mkdir(exist_ok=True)
        count = len(blocks.parts())
        noted = ((number, _noted(done / f"{number}.npz", group)) for number in range(count))
        bricks = {number: known for number, known in noted if known}
        missing = [number for number in range(count) if number not in bricks]
        made = elsewhere(folder, missing) if elsewhere else ((n, write_part(plan, group, n)) for n in missing)
        for number, known in made:
            _note(done / f"{number}.npz", known)
            bricks[number] = known
            progress(BUILT * len(bricks) / count)
        progress(BUILT)
        group.finish(kept_bricks(*_joined([bricks[number] for number in range(count)]), blocks.shape))
        write_packed(folder, part_of(progress, BUILT, 1.0 - BUILT))


def group_of(plan: BoxPlan, folder: Path, begun: bool = False) -> BoxGroup:
    """The Zarr group of a box in a folder. begun: another process has made it."""
    blocks = plan.blocks
    return BoxGroup(folder, blocks.shape, plan.header, blocks.colours, blocks.material, begun)


def write_part(plan: BoxPlan, group: BoxGroup, number: int) -> Bricks:
    """Write the blocks of a part of the plan; its bricks that hold matter."""

    def write(block_and_values: tuple[Block, dict[str, NDArray]]) -> Bricks:
        block, values = block_and_values
        group.write(block, values)
        flags = matter_flags(filled(values["density"] > 0))
        held = np.argwhere(flags)
        return held + np.array(block) * BLOCK, flags[tuple(held.T)]

    return _joined(list(in_order(write, plan.blocks.read(plan.blocks.parts()[number]))))


def _joined(bricks: list[Bricks]) -> Bricks:
    places = np.concatenate([np.zeros((0, 3), np.int64), *(places for places, _ in bricks)])
    return places, np.concatenate([np.zeros(0, np.uint8), *(flags for _, flags in bricks)])


def _note(path: Path, bricks: Bricks) -> None:
    """Note that a part is done."""
    partial = path.with_suffix(".partial")
    with partial.open("wb") as file:
        np.savez(file, places=bricks[0], flags=bricks[1])
    os.replace(partial, path)


def _noted(path: Path, group: BoxGroup) -> Bricks | None:
    """What was noted of a part; None unless its blocks are there, too (after a loss of power they may not be)."""
    if not path.exists():
        return None
    try:
        with np.load(path) as noted:
            places, flags = noted["places"], noted["flags"]
    except (OSError, ValueError, KeyError, EOFError, BadZipFile):
        places, flags = np.zeros((1, 3), np.int64) - 1, np.zeros(1, np.uint8)
    if all(group.holds((z, y, x)) for z, y, x in np.unique(places // BLOCK, axis=0).tolist()):
        return places, flags
    path.unlink()
    return None
