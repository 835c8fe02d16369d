"""One scene of `backends_scenes.py` on the backend of this process: what `backends.py` starts for each.

    python benchmarks/backends_child.py OUT SCENE --seed 0 --rounds 3 --voxels 512 --aspect 1.78 --lines 1080 2160

Leaves: OUT.json, of every size times and memory, as they come; OUT_LINES.npz, what is compared; OUT_LINES.png.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from backends_scenes import CASES, BackendCase, sized

import hagoromo as hg


def main() -> None:
    """Render the scene at every size."""
    parser = argparse.ArgumentParser()
    parser.add_argument("out", type=Path)
    parser.add_argument("scene", choices=CASES)
    for option, kind in (("seed", int), ("rounds", int), ("voxels", int), ("aspect", float)):
        parser.add_argument(f"--{option}", type=kind, required=True)
    parser.add_argument("--lines", nargs="+", type=int, required=True)
    asked = parser.parse_args()
    case, frames, start = CASES[asked.scene], [], time.perf_counter()
    scene = case.make(asked.voxels)
    built = time.perf_counter() - start
    for lines in asked.lines:
        turns = [timed(case, sized(scene, lines, asked.aspect), asked.seed) for _ in range(1 + asked.rounds)]
        taken = [seconds for seconds, _ in turns]  # the first with the compilation of kernels
        name = f"{asked.out.name}_{lines}"
        values = values_of(turns[-1][1], asked.out.with_name(f"{name}.png"))
        np.savez_compressed(asked.out.with_name(f"{name}.npz"), allow_pickle=False, **values)
        frame = {"scene": asked.scene, "lines": lines, "values": f"{name}.npz", "built_s": built, **memory()}
        frames.append({**frame, "first_s": taken[0], "seconds": float(np.median(taken[1:] or taken))})
        hg.write_json(asked.out.with_suffix(".json"), frames)


def timed(case: BackendCase, scene: hg.Scene, seed: int) -> tuple[float, Any]:
    """Wall time of a picture [s], or of a gradient, and it."""
    if case.mode == "gradient":
        shape = hg.render(scene, replace(case.settings(), walks=0), mode="full").weights.shape
        weights = np.random.default_rng(1).random(shape)
    start = time.perf_counter()
    if case.mode == "gradient":
        found: Any = hg.full_gradient(scene, weights, case.settings())
    else:
        found = hg.render(scene, case.settings(seed), mode=case.mode)
    return time.perf_counter() - start, found


def values_of(found: Any, png: Path) -> dict[str, np.ndarray]:
    """What is compared: colour and coverage, or Y and its variance where there is noise; or a gradient."""
    if not isinstance(found, hg.Image):
        return {"gradient": found.values}
    hg.write_png(png, found.display())
    if found.variance is not None:
        return {"alpha": found.alpha, "y": found.xyz()[..., 1], "variance": found.variance}
    return {"alpha": found.alpha, "colour": found.linear_srgb().astype(np.float32)}


def memory() -> dict[str, float]:
    """Memory of this process, and on the GPU where NVIDIA's driver says it [GiB]."""
    import psutil

    found = {"memory_gib": psutil.Process().memory_info().rss / 2**30}
    command = ["nvidia-smi", "--query-compute-apps=pid,used_memory", "--format=csv,noheader,nounits"]
    try:
        said = subprocess.run(command, capture_output=True, text=True, check=True, timeout=20).stdout
    except (OSError, subprocess.SubprocessError):
        return found
    held = [line.split(",") for line in said.splitlines()]
    own = [float(mib) / 2**10 for pid, mib in held if pid.strip() == str(os.getpid()) and mib.strip().isdigit()]
    return found | ({"gpu_gib": own[0]} if own else {})


if __name__ == "__main__":
    main()
