"""Light of all orders on 1, 2 and 4 workers: a ball by mode full, and figure 8 by mode path, with one worker killed.

Figure 8 at 2160 lines to an error of 2 % is too long for this machine: it is measured at 1/SMALLER of the width and
height, and what the whole picture takes is computed from that.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

import hagoromo as hg
from hagoromo.cluster.cluster import workers_of
from hagoromo.files.cache import PLACE
from hagoromo.image.path.picture import path_picture
from hagoromo.image.path.walk_sums import FIRST_WALKS, WalkSums
from hagoromo.image.render_tiles import render_tiles
from hagoromo.image.scene_on_worker import TASKS_PER_WORKER, SceneOrder
from hagoromo.image.walk_tiles import PIXELS, walk_on
from hagoromo_matter.demo.figure_scene import camera_of, cast_of, resized_scene, write_figure_scene
from studies.cluster_bench import SCENE, cpu_seconds, load
from studies.cluster_simulation import Machines, SimulatedRun, SimulatedWork

WORKERS = (1, 2, 4)
BALL_SIZE = 320, 240
FIGURE = "figure_8_whole"
WIDTH = 3240  # px of the whole picture, of 2160 lines
SMALLER = 30
WALKS = 32  # a pixel
ERROR = 0.02
MODES_ROWS = Path(__file__).with_name("modes_rows.json")
PAPER_WORKERS, PAPER_CORES = (1, 10, 100), 16


def full_rows(home: Path) -> dict[str, Any]:
    """The ball that lies in the folder `home` by mode full, without walks: where each worker solves, as all did until
    version 0.3 and do without a cache, and where one of them does.
    """
    scene, settings = home / "full.toml", hg.Settings(walks=0)
    text = SCENE.replace('file = "ball.zarr"', 'file = "ball.zarr"\nextinction = "projected"')
    scene.write_text(text % (*BALL_SIZE, BALL_SIZE[0], BALL_SIZE[0]), encoding="utf-8")
    whole = hg.render(scene, settings, mode="full")
    rows = []
    for shared in (False, True):
        for count in WORKERS:
            kept = scene.parent / f"kept_{count}"
            with environment(PLACE, str(kept) if shared else "off"), workers_of(count) as cluster:
                before = cpu_seconds(cluster)
                image = render_tiles(scene, settings, cluster, mode="full")
                after = cpu_seconds(cluster)
            rows.append(
                {
                    "workers": count, "shared": shared, "cpu_s": sum(after.values()) - sum(before.values()),
                    "same_bits": same_bits(image, whole), "kept_bytes": bytes_in(kept),
                }
            )  # fmt: skip
    cells = whole.metadata["field"]["cells"]
    return {"rows": rows, "cells": cells, "size": list(BALL_SIZE), "samples": settings.samples, "load": load()}


def figure_rows(demo: Path, home: Path, progress: hg.Progress = hg.silent) -> dict[str, Any]:
    """Figure 8 of the demo's materials by mode path on workers, and the walks that an error of ERROR takes."""
    file = home / FIGURE / "scene.toml"
    write_figure_scene(cast_of(demo, None, "projected"), FIGURE, camera_of(WIDTH), file.parent)
    small = resized_scene(file, WIDTH // SMALLER)
    settings, sums = hg.Settings(samples=WALKS), list[WalkSums]()
    whole = hg.render(small, settings, mode="path")
    rows, cases = [], [*((count, False) for count in WORKERS), (2, True)]
    for number, (count, killed) in enumerate(cases):
        progress(number / len(cases), f"figure 8 on {count} workers")
        rows.append(figure_row(small, settings, whole, count, killed, sums))
    pixels = whole.alpha.size
    wanted = sums[-1].walks_for(ERROR)
    return {
        "rows": rows, "size": [whole.alpha.shape[1], whole.alpha.shape[0]], "walks": WALKS, "noise": sums[-1].error(),
        "walks_for_error": float(np.maximum(wanted, FIRST_WALKS).mean()), "error": ERROR, "pixels": pixels,
        "whole_pixels": pixels * SMALLER**2, "whole_size": [WIDTH, whole.alpha.shape[0] * SMALLER],
        "boxes_bytes": bytes_in(file.parent), "load": load(), "cores": os.cpu_count(),
    }  # fmt: skip


def figure_row(
    small: Path, settings: hg.Settings, whole: hg.Image, count: int, killed: bool, last: list[WalkSums]
) -> dict[str, Any]:
    """One picture by `count` workers, one of them killed when its first task is done; `last` gets its sums."""
    order, shares = SceneOrder.of(small, settings, "path"), list[float]()
    with workers_of(count) as cluster:
        before = cpu_seconds(cluster)
        cluster.client.run(ready_for_walks, order)
        ready = cpu_seconds(cluster)

        def after_a_task(share: float, step: str = "") -> None:
            shares.append(share)
            if killed and len(shares) == 1:
                os.kill(min(ready), signal.SIGKILL)

        def walk(number: int, scene: hg.Scene, sums: WalkSums, share: float, progress: hg.Progress) -> None:
            walk_on(order, cluster, number, scene, sums, share, progress)
            last[:] = [sums]

        image = path_picture(order.scene(), settings, after_a_task, walk=walk)
        after = cpu_seconds(cluster)
    walked = sum(after[pid] - ready[pid] for pid in after if pid in ready)
    return {
        "workers": count, "killed": killed, "tasks": len(shares), "same_bits": same_bits(image, whole),
        "prepare_cpu_s": (sum(ready.values()) - sum(before.values())) / count, "cpu_s": walked,
    }  # fmt: skip


def ready_for_walks(order: SceneOrder) -> None:
    """On a worker: the scene is read and on the device."""
    from hagoromo.image.scene_on_worker import held_scene
    from hagoromo.image.walk_tiles import _stream

    held = held_scene(order)
    held.ready(("path", 0), lambda: _stream(held, 0))


def figure_of_modes(boxes_bytes: float, prepare_s: float) -> dict[str, Any]:
    """What `on_paper` takes of FIGURE, by its row on the page of modes, where it is not measured on workers.

    boxes_bytes, prepare_s: to fetch, and until they are ready; assumed. Every pixel gets as many walks.
    """
    row = hg.read_json(MODES_ROWS)[FIGURE]
    wide, high = row["size"]
    one = {"workers": 1, "cpu_s": row["seconds"]["path"], "prepare_cpu_s": prepare_s}
    high_whole = round(WIDTH * high / wide)
    return {
        "rows": [one], "pixels": wide * high, "size": row["size"], "walks": row["walks"], "noise": row["noise_of_path"],
        "walks_for_error": row["walks"] * (row["noise_of_path"] / ERROR) ** 2, "error": ERROR,
        "whole_size": [WIDTH, high_whole], "whole_pixels": WIDTH * high_whole, "boxes_bytes": boxes_bytes,
    }  # fmt: skip


def on_paper(figure: dict[str, Any], scheduler_s: float) -> dict[str, Any]:
    """CPU time of the whole picture, and by simulation its time on workers of PAPER_CORES cores.

    Walks are made in steps, each of which doubles those of every pixel and ends before the next begins.
    """
    one = next(row for row in figure["rows"] if row["workers"] == 1)
    walk_s = one["cpu_s"] / (figure["pixels"] * figure["walks"])
    pixels, walks = figure["whole_pixels"], figure["walks_for_error"]
    rows = []
    for workers in PAPER_WORKERS:
        machines = Machines(workers, scheduler_s=scheduler_s)
        size = min(max(pixels // (TASKS_PER_WORKER * workers), PIXELS[0]), PIXELS[1])
        tasks = -(-pixels // size)
        work = SimulatedWork(1, 1 << 40, figure["boxes_bytes"], one["prepare_cpu_s"], 0.0, 8.0 * (size * 40))
        run = SimulatedRun(work, machines, seed=0)
        for step in steps(walks):
            run.work = SimulatedWork(**{**vars(work), "work_s": size * step * walk_s / PAPER_CORES})
            run.run(tasks)
        result = run.result()
        rows.append({"workers": workers, "seconds": result.seconds, "working": result.working, "deaths": result.deaths})
    return {"rows": rows, "walk_s": walk_s, "cpu_s": walk_s * pixels * walks, "cores": PAPER_CORES}


def steps(walks: float) -> Iterator[float]:
    """Walks a pixel of each step until there are `walks`."""
    done = 0.0
    while done < walks:
        step = min(max(done, float(FIRST_WALKS)), walks - done)
        yield step
        done += step


def same_bits(one: hg.Image, other: hg.Image) -> bool:
    """Whether two pictures are the same, bit by bit."""
    arrays = ((one.weights, other.weights), (one.alpha, other.alpha), (one.variance, other.variance))
    return all(a is b or (a is not None and b is not None and np.array_equal(a, b)) for a, b in arrays)


def bytes_in(folder: Path) -> int:
    """Of all files in a folder."""
    return sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())


@contextmanager
def environment(name: str, value: str) -> Iterator[None]:
    """A variable of the environment, of this process and those that it starts, while the block runs."""
    before = os.environ.get(name)
    os.environ[name] = value
    try:
        yield
    finally:
        if before is None:
            del os.environ[name]
        else:
            os.environ[name] = before
