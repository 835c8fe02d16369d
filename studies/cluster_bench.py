"""What this machine gives with 1, 2 and 4 workers, with one of them killed, and what a task costs beside its work."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path
from typing import Any

import numpy as np

import hagoromo as hg
from hagoromo.cluster.cluster import Cluster, workers_of
from hagoromo.image.render_tiles import render_tiles

SIZE = 640, 480
EMPTY_TASKS = 1000
RECIPE = """
kind = "solid"
voxel_mm = 0.1
mean_free_path_mm = 0.3
shape = {form = "sphere", radius_mm = 8.0}
material = {alpha = 0.2, beta = 0.1, gamma = 0.2, n = 1.5, body_colour = 0.8}
"""
SCENE = """
[camera]
size = [%d, %d]
focal = [%d, %d]
eye = [0.0, -0.05, 0.02]
target = [0.0, 0.0, 0.008]
[[lamp]]
position = [0.1, -0.2, 0.2]
intensity = 0.1
[[lamp]]
position = [-0.2, -0.1, 0.1]
intensity = 0.05
[[box]]
file = "ball.zarr"
[render]
samples = 4
"""


def measured(home: Path, progress: hg.Progress = hg.silent) -> dict[str, Any]:
    """All figures, from a scene that is made in the folder `home`."""
    (home / "ball.toml").write_text(RECIPE, encoding="utf-8")
    hg.build_to(home / "ball.toml", home / "ball.zarr")
    (home / "scene.toml").write_text(SCENE % (*SIZE, SIZE[0], SIZE[0]), encoding="utf-8")
    _, settings = hg.load_scene(home / "scene.toml")
    whole = hg.render(home / "scene.toml")
    rows = []
    for number, (count, killed) in enumerate([(1, False), (2, False), (2, True), (4, False)]):
        progress(number / 5, f"{count} workers")
        rows.append(workers_row(home / "scene.toml", settings, whole, count, killed))
    progress(0.9, "empty tasks")
    return {
        "rows": rows, "pixels": SIZE[0] * SIZE[1], "samples": settings.samples, "cores": os.cpu_count(),
        "load": load(), "task": empty_tasks(),
    }  # fmt: skip


def workers_row(scene: Path, settings: hg.Settings, whole: hg.Image, count: int, killed: bool) -> dict[str, Any]:
    """One picture by `count` workers that have the scene ready, one of them killed at the first tile if `killed`."""
    begun = time.perf_counter()
    with workers_of(count) as cluster:
        started = time.perf_counter() - begun
        before = cpu_seconds(cluster)
        begun = time.perf_counter()
        render_tiles(scene, settings, cluster)  # each worker makes the scene ready
        ready = time.perf_counter() - begun
        prepared = cpu_seconds(cluster)
        shares: list[float] = []

        def tell(share: float, step: str = "") -> None:
            shares.append(share)
            if killed and len(shares) == 2:
                os.kill(min(cluster.client.run(os.getpid).values()), signal.SIGKILL)

        begun, own = time.perf_counter(), time.process_time()
        image = render_tiles(scene, settings, cluster, tell)
        wall, own = time.perf_counter() - begun, time.process_time() - own
        after = cpu_seconds(cluster)
    same = {pid for pid in after if pid in prepared}
    return {
        "workers": count, "killed": killed, "start_s": started, "ready_s": ready, "wall_s": wall,
        "prepare_cpu_s": sum(prepared[pid] - before.get(pid, 0.0) for pid in prepared) / count,
        "cpu_s": sum(after[pid] - prepared[pid] for pid in same), "client_cpu_s": own, "tiles": len(shares) - 1,
        "same_bits": bool(np.array_equal(image.weights, whole.weights) and np.array_equal(image.alpha, whole.alpha)),
    }  # fmt: skip


def load() -> float:
    """Processes that want a core, the mean over a minute; 0 where the system does not say."""
    return os.getloadavg()[0] if hasattr(os, "getloadavg") else 0.0


def cpu_seconds(cluster: Cluster) -> dict[int, float]:
    """Process → its seconds of CPU so far."""
    pids, seconds = cluster.client.run(os.getpid), cluster.client.run(time.process_time)
    return {pids[worker]: seconds[worker] for worker in pids}


def empty_tasks() -> dict[str, float]:
    """Time of a task that does nothing, of two workers; the CPU time is that of client and scheduler together."""
    with workers_of(2) as cluster:
        list(cluster.results(abs, ((number,) for number in range(100))))
        begun, own = time.perf_counter(), time.process_time()
        list(cluster.results(abs, ((number,) for number in range(EMPTY_TASKS))))
        wall, own = time.perf_counter() - begun, time.process_time() - own
    return {"count": EMPTY_TASKS, "wall_s": wall / EMPTY_TASKS, "cpu_s": own / EMPTY_TASKS}
