"""The study of many machines: what workers give on this machine, and by simulation what 1, 100 and 1000 would.

    python -m studies.cluster --out out/cluster --demo out/demo

Enters: the folder of a demo, whose materials figure 8 has; without one the tables of modes full and path are left as
they were. Leaves: results.json, cluster.md and cluster.png, which belong to docs, and cluster_orders.json, which lies
beside this file.
"""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import hagoromo as hg
from studies.cluster_bench import measured
from studies.cluster_orders import figure_of_modes, figure_rows, full_rows, on_paper
from studies.cluster_page import write_cluster_page
from studies.cluster_simulation import Machines, SimulatedWork, simulate
from studies.command import command

WORKERS = (1, 3, 10, 32, 100, 320, 1000)
FRAMES, RAYS = 192, 4 * 3840 * 2160  # 8 s of 24 frames; 4 rays a pixel
BOXES_BYTES = 4.0e9  # of the angel and the nun; `make figures` takes 8 GB
HEAVIER = 4.0  # cost of a ray of figure 8 over one of the scene that is measured here: assumed
PREPARE_S = 60.0  # of figure 8: boxes to the device, shadow maps of three lamps; assumed
WORKER_CORES = 16
ORDERS_ROWS = Path(__file__).with_name("cluster_orders.json")  # of the page as it stands
CAPTURES = SimulatedWork(
    scenes=10_000, tasks=1, fetched=12 * 20e6, prepare_s=0.0, work_s=120.0, returned=2e3, spread=0.5
)


def cluster_study(
    out: str | Path, demo: Path | None = None, force: bool = False, progress: hg.Progress = hg.silent
) -> dict[str, Any]:
    """The whole study, written to the folder `out`; gives the record of results.json."""
    with hg.whole_folder(out, force) as home:
        scratch = home / "scratch"
        scratch.mkdir()
        here = measured(scratch, hg.part_of(progress, 0.0, 0.4))
        orders = hg.read_json(ORDERS_ROWS)
        if demo is not None:
            figure = figure_rows(demo, scratch, hg.part_of(progress, 0.5, 0.5))
            orders = {"full": full_rows(scratch), "figure": figure}
        modes = figure_of_modes(BOXES_BYTES, PREPARE_S)
        paper, by_modes = (
            on_paper(by, here["task"]["cpu_s"]) | {"by": by} for by in (orders["figure"] or modes, modes)
        )
        record = {
            "hagoromo": hg.__version__, "here": here, **orders, "paper": paper, "by_modes": by_modes,
            "simulated": simulated(here),
        }  # fmt: skip
        hg.write_json(home / ORDERS_ROWS.name, orders)
        for path in sorted(scratch.rglob("*"), reverse=True):
            path.rmdir() if path.is_dir() else path.unlink()
        scratch.rmdir()
        hg.write_json(home / "results.json", record)
        write_cluster_page(home, record)
    progress(1.0)
    return record


def simulated(here: dict[str, Any]) -> dict[str, Any]:
    """The film and the captures by workers of 16 cores, with the scheduler's time and a ray's cost as measured here."""
    one = next(row for row in here["rows"] if row["workers"] == 1)
    ray_s = one["cpu_s"] / (here["pixels"] * here["samples"])
    frame_s = HEAVIER * ray_s * RAYS / WORKER_CORES
    film = SimulatedWork(FRAMES, 1, BOXES_BYTES, PREPARE_S, frame_s, 2e3)
    model = Machines(1, scheduler_s=here["task"]["cpu_s"])
    rows = []
    for workers in WORKERS:
        machines, alone_s = replace(model, workers=workers), film.alone_s(model)
        tiles = max(min(8 * workers, -(-RAYS // 4 // (1 << 14))), 16)
        tiled = replace(film, tasks=tiles, work_s=frame_s / tiles, returned=8.0e8 / tiles, one_by_one=True)
        rows.append(row("film, frames", film, machines, alone_s) | {"tasks": FRAMES})
        rows.append(row("film, tiles", tiled, machines, alone_s) | {"tasks": FRAMES * tiles})
        kept = replace(film, scenes=1, tasks=FRAMES)
        rows.append(row("film, kept", kept, machines, alone_s) | {"tasks": FRAMES})
        rows.append(row("captures", CAPTURES, machines, CAPTURES.alone_s(machines)) | {"tasks": CAPTURES.scenes})
    return {
        "rows": rows, "ray_s": ray_s, "frame_s": frame_s, "film": asdict(film), "captures": asdict(CAPTURES),
        "machines": asdict(model), "heavier": HEAVIER, "cores": WORKER_CORES,
    }  # fmt: skip


def row(kind: str, work: SimulatedWork, machines: Machines, alone_s: float) -> dict[str, Any]:
    """A simulation, its speed over one worker that takes `alone_s`, and what bounds it."""
    result = simulate(work, machines)
    tasks = work.tasks if work.one_by_one else work.tasks * work.scenes
    speed, bound = alone_s / result.seconds, result.bound_by(machines.workers, tasks)
    return {"kind": kind, "workers": machines.workers, **asdict(result), "speed": speed, "bound": bound}


def main(out: Path, demo: Path | None = None, force: bool = False) -> None:
    """Measure workers on this machine and simulate many.

    Args:
        out: where to write results.json, cluster.md, cluster.png and cluster_orders.json.
        demo: folder of a demo, whose materials figure 8 has; without it modes full and path are not measured anew.
        force: replace an existing result.
    """
    with hg.progress_bar("cluster") as progress:
        cluster_study(out, demo, force, progress)
    print(f"wrote {out / 'cluster.md'}")


if __name__ == "__main__":
    command(main)
