"""Build a box straight to disk, block by block: memory follows a block, and what is done outlives an interruption."""

from __future__ import annotations

import os
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from hagoromo.files.resumable import resumable_folder
from hagoromo.progress import Progress, part_of, silent
from hagoromo.volume.store.blocks import Block, filled, kept_bricks, matter_flags
from hagoromo.volume.store.box_group import BoxGroup
from hagoromo.volume.store.box_store import save_box
from hagoromo.volume.store.packed_bricks import write_packed
from hagoromo.volume.store.plan import BoxPlan
from hagoromo.volume.store.zarr_blocks import in_order
from hagoromo.volume.table import BLOCK

BUILT = 0.7  # of the work, when all blocks are written and their bricks are to be packed
Bricks = tuple[NDArray[np.int64], NDArray[np.uint8]]  # places (n, 3) of bricks with matter, and their `matter_flags`


def build_box(
    plan: BoxPlan,
    path: str | Path,
    fingerprint: str,
    force: bool = False,
    progress: Progress = silent,
) -> None:
    """Build the box of `plan` at `path`, whole or not at all.

    fingerprint: text that differs for plans of different voxels; a run that was cut off is taken up again by the next
    one with the same, see `resumable_folder`, which also says what is raised.
    """
    blocks = plan.blocks
    if plan.header.texel:  # small: built in memory
        save_box(plan.box(), path, force)
        return
    with resumable_folder(path, fingerprint, force) as folder:
        group = BoxGroup(folder, blocks.shape, plan.header, blocks.colours, blocks.material)
        done = folder.parent / "done"
        done.mkdir(exist_ok=True)

        def write(block_and_values: tuple[Block, dict[str, NDArray]]) -> Bricks:
            block, values = block_and_values
            group.write(block, values)
            flags = matter_flags(filled(values["density"] > 0))
            held = np.argwhere(flags)
            return held + np.array(block) * BLOCK, flags[tuple(held.T)]

        parts, bricks = blocks.parts(), []
        for number, part in enumerate(parts):
            path = done / f"{number}.npz"
            noted = _noted(path, group) or _joined(list(in_order(write, blocks.read(part))))
            if not path.exists():
                _note(path, noted)
            bricks.append(noted)
            progress(BUILT * (number + 1) / len(parts))
        group.finish(kept_bricks(*_joined(bricks), blocks.shape))
        write_packed(folder, part_of(progress, BUILT, 1.0 - BUILT))


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
