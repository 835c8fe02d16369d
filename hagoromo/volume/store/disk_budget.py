"""Disk budget: whether the box of a plan fits the disk that is free, asked before it is built."""

from __future__ import annotations

import math
import shutil
from pathlib import Path

import numpy as np

from hagoromo.errors import InputError
from hagoromo.files.leftovers import beside
from hagoromo.files.whole import scratch_folder
from hagoromo.volume.store.blocks import BLOCK_SIDE
from hagoromo.volume.store.box_group import BoxGroup
from hagoromo.volume.store.plan import BoxPlan

DRAWS = 32  # of blocks, whose sizes on disk stand for those of all
STANDARD_ERRORS = 2.0  # that the estimate must be too large by before a box is refused
COPIES = 2  # the blocks, and their bricks as the device holds them


def check_disk(plan: BoxPlan, path: str | Path) -> None:
    """Raise `InputError` where the box of `plan` will not fit the disk of `path`; no work where it does in any case.

    Where even its voxels as they are in memory would fit, nothing is asked further. Else some blocks are evaluated and
    written to a scratch folder. What an interrupted build has written counts as free.
    """
    count = sum(len(part) for part in plan.blocks.parts())
    voxel = 8 + 2 * plan.blocks.colours + plan.blocks.material  # bytes: density and axis, colours, material
    home = next(folder for folder in Path(path).absolute().parents if folder.is_dir())
    free = shutil.disk_usage(home).free + size_on_disk(beside(Path(path).absolute(), "building"))
    if COPIES * count * voxel * BLOCK_SIDE**3 <= free:
        return
    needed, error = estimated_size(plan)
    if needed - STANDARD_ERRORS * error > free:
        raise InputError(
            f"{path}: the box needs about {needed / 2**30:.2g} GiB on the disk and {free / 2**30:.2g} GiB are free in "
            f"{home}: make room, write to another disk, or make the voxels larger"
        )


def estimated_size(plan: BoxPlan) -> tuple[float, float]:
    """Bytes on disk of the box of a plan, from blocks that are drawn and written, and the standard error of that.

    Mean of size / probability (Hansen & Hurwitz 1943), which is right on the average, however uneven the blocks are.
    """
    blocks, estimates = plan.blocks, []
    with scratch_folder() as folder:
        group = BoxGroup(folder, blocks.shape, plan.header, blocks.colours, blocks.material)
        for probability, drawn in blocks.drawn(DRAWS):
            size = 0
            for block, values in drawn:
                group.write(block, values)
                size += group.size(block)
            estimates.append(COPIES * size / probability)
    if not estimates:
        return 0.0, 0.0
    return float(np.mean(estimates)), float(np.std(estimates, ddof=1) / math.sqrt(len(estimates)))


def size_on_disk(folder: Path) -> int:
    """Bytes of all files in a folder; 0 where there is none."""
    return sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())
