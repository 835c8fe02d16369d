"""Build a box straight to disk, block by block: memory follows a block, and what is done outlives an interruption."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hagoromo.files.resumable import resumable_folder
from hagoromo.volume.blocks import Block, filled, kept_bricks, matter_flags
from hagoromo.volume.box_group import BoxGroup
from hagoromo.volume.plan import BoxPlan
from hagoromo.volume.table import BLOCK
from hagoromo.volume.zarr_blocks import in_order


def build_box(
    plan: BoxPlan,
    path: str | Path,
    fingerprint: str,
    force: bool = False,
    progress: Callable[[float], None] | None = None,
) -> None:
    """Build the box of `plan` at `path`, whole or not at all.

    fingerprint: text that differs for plans of different voxels; a run that was cut off is taken up again by the next
    one with the same, see `resumable_folder`, which also says what is raised. progress: told the share done, 0…1.
    """
    blocks = plan.blocks
    with resumable_folder(path, fingerprint, force) as folder:
        group = BoxGroup(folder, blocks.shape, plan.header, blocks.colours, blocks.material)
        done = folder.parent / "done"
        done.mkdir(exist_ok=True)

        def write(block_and_values: tuple[Block, dict[str, NDArray]]) -> tuple[NDArray, NDArray]:
            block, values = block_and_values
            group.write(block, values)
            flags = matter_flags(filled(values["density"] > 0))
            held = np.argwhere(flags)
            return held + np.array(block) * BLOCK, flags[tuple(held.T)]

        parts = blocks.parts()
        for number, part in enumerate(parts):
            if not (done / f"{number}.npz").exists():
                _note(done / f"{number}.npz", list(in_order(write, blocks.read(part))))
            if progress:
                progress((number + 1) / len(parts))
        places, flags = _noted([done / f"{number}.npz" for number in range(len(parts))])
        group.finish(kept_bricks(places, flags, blocks.shape))


def _note(path: Path, bricks: list[tuple[NDArray, NDArray]]) -> None:
    """Note that a part is done: the places (n, 3) of its bricks with matter, and their `matter_flags`."""
    places = np.concatenate([np.zeros((0, 3), np.int64), *(places for places, _ in bricks)])
    flags = np.concatenate([np.zeros(0, np.uint8), *(flags for _, flags in bricks)])
    partial = path.with_suffix(".partial")
    with partial.open("wb") as file:
        np.savez(file, places=places, flags=flags)
    os.replace(partial, path)


def _noted(paths: list[Path]) -> tuple[NDArray[np.int64], NDArray[np.uint8]]:
    parts = [(np.zeros((0, 3), np.int64), np.zeros(0, np.uint8))]
    for path in paths:
        with np.load(path) as noted:
            parts.append((noted["places"], noted["flags"]))
    return np.concatenate([places for places, _ in parts]), np.concatenate([flags for _, flags in parts])
