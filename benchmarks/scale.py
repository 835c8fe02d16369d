"""Boxes of any size: time and resident memory to build and render shells, each in a process of its own.

A fuzzy shell in effective 1024³ voxels, a thin one in 4096³, and one that the machine's memory cannot hold, which is
refused in one line. Pictures of 512² pixels, three lamps with shadow maps. Written to out/bench/scale.json.

    python benchmarks/scale.py [--rounds 5] [--finest 4096]
"""

from __future__ import annotations

import multiprocessing
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from peers_child import peak_memory
from scaling import LAMPS, PIXELS, frames
from shells import FUZZY, RADIUS, THIN, Shell
from turns import in_turn, medians, options, record, seconds

import hagoromo as hg
from hagoromo.files.memory import SHARE_OF_MEMORY, free_memory
from hagoromo.volume.bricks import brick_bytes
from hagoromo.volume.voxels import BRICK

BOXES = ((FUZZY, 1024), (THIN, 4096))
GIB = 2.0**30
SPILL = 1.6  # bricks by which those that hold matter of a shell are thicker than it


def main() -> None:
    """A row a box, then the refusal."""
    parser = options(__doc__, 5)
    parser.add_argument("--finest", type=int, default=4096, help="voxels a side of the largest box; 4096 takes 6 GiB")
    asked = parser.parse_args()
    rows = []
    for shell, voxels in BOXES:
        if voxels <= asked.finest:
            rows.append(alone(measured, shell, voxels, asked.rounds))
            print(rows[-1], flush=True)
    refusal = alone(refused, FUZZY, too_fine(FUZZY))
    print(refusal, flush=True)
    record("scale", {"boxes": rows, "refused": refusal})


def alone(work: Callable[..., dict[str, Any]], *given: Any) -> dict[str, Any]:
    """What `work` returns, run in a fresh process."""
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        return pool.apply(work, given)


def measured(shell: Shell, voxels: int, rounds: int) -> dict[str, Any]:
    """Build and render a shell: seconds, bricks, and peaks of resident memory [GiB]."""
    start = time.perf_counter()
    box = shell.box(voxels)
    built, peak = time.perf_counter() - start, peak_memory() / 1024
    turns = frames([box], PIXELS, LAMPS)
    first = seconds(turns["mapped_s"])
    return {
        "shell": shell.name, "voxels": voxels, "bricks": int(np.prod(box.bricks.lattice)), "kept": box.bricks.kept,
        "dense_gib": 8 * voxels**3 / GIB, "held_gib": box.bricks.bytes / GIB, "build_s": built, "build_gib": peak,
        "first_s": first, **medians(in_turn(turns, rounds, 30.0)), "peak_gib": peak_memory() / 1024,

    }  # fmt: skip


def refused(shell: Shell, voxels: int) -> dict[str, Any]:
    """What is said of a box that does not fit, and when [s]."""
    start = time.perf_counter()
    try:
        shell.box(voxels)
        said = ""
    except hg.InputError as error:
        said = str(error)
    return {
        "shell": shell.name, "voxels": voxels, "said": said,
        "seconds": time.perf_counter() - start, "peak_gib": peak_memory() / 1024,
    }  # fmt: skip


def too_fine(shell: Shell) -> int:
    """Voxels a side, a power of two, at which the shell's bricks need more than the memory that may be taken."""
    voxels, area = 1024, 4 * np.pi * RADIUS**2
    while area * (voxels / BRICK) ** 2 * (shell.thickness * voxels / BRICK + SPILL) * brick_bytes() < allowed():
        voxels *= 2
    return voxels


def allowed() -> float:
    """Memory that one box may take [byte]."""
    return SHARE_OF_MEMORY * free_memory()


if __name__ == "__main__":
    main()
