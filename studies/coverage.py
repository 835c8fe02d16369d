"""The study of coverage: how often the 95 % intervals of a material's parameters contain the true value.

    python -m studies.coverage --out out/coverage [--scheduler 4]

Each simulation has its own seed, so that its result is the same wherever it runs. Enters: nothing.
Leaves: results.json, coverage.md and coverage.png, which belong to docs.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

import hagoromo as hg
from hagoromo.app.shared_options import HERE, Scheduler
from hagoromo.cluster.cluster import mapped
from studies.command import command
from studies.coverage_bench import BENCHES, FULL_WELLS, CoverageBench, TrueMaterial, drawn, observed
from studies.coverage_page import write_coverage_page

SIMULATIONS = 200
QUANTITIES = ("alpha", "beta", "gamma", "n", "nu", "specular_albedo", "body_colour", "interface_colour")


def coverage_study(
    out: str | Path,
    simulations: int = SIMULATIONS,
    force: bool = False,
    progress: hg.Progress = hg.silent,
    scheduler: str | int | None = None,
) -> dict[str, Any]:
    """The whole study, written to the folder `out`; gives the record of results.json. scheduler: see `hg.render`."""
    cases = [(bench, level) for bench in BENCHES for level in FULL_WELLS]
    tasks = [
        (BENCHES[bench], FULL_WELLS[level], np.random.default_rng([i, k]))
        for i, (bench, level) in enumerate(cases)
        for k in range(simulations)
    ]
    names = [f"{bench}, {level}" for bench, level in cases for _ in range(simulations)]
    with hg.whole_folder(out, force) as home:
        results = mapped(simulated, tasks, scheduler, progress, names)
        rows = [
            {"bench": bench, "level": level, **row}
            for i, (bench, level) in enumerate(cases)
            for row in table(results[i * simulations : (i + 1) * simulations])
        ]
        record = {"hagoromo": hg.__version__, "simulations": simulations, "rows": rows}
        hg.write_json(home / "results.json", record)
        write_coverage_page(home, record)
        progress(1.0, "")
    return record


def simulated(
    bench: CoverageBench, full_well: float, random: np.random.Generator
) -> tuple[TrueMaterial, hg.MaterialEstimate]:
    """One material drawn, observed and estimated."""
    truth = drawn(bench, random)
    return truth, hg.estimate_material(observed(bench, truth, full_well, random), "material", 1)


def table(results: list[tuple[TrueMaterial, hg.MaterialEstimate]]) -> list[dict[str, Any]]:
    """Per quantity: number of intervals, of those that contain the truth, lie above and below it, and are identifiable.

    relative_width: median width, relative to the truth, of the intervals of identifiable quantities.
    """
    rows = []
    for key in QUANTITIES:
        true = np.array([np.atleast_1d(truth.values()[key]) for truth, _ in results])
        unknown = np.tile([0.0, np.inf], (true.shape[1], 1))  # of a matte material
        bounds = np.array([np.atleast_2d(estimate.interval_95.get(key, unknown)) for _, estimate in results])
        identifiable = np.array([estimate.identifiable.get(key, True) for _, estimate in results])
        low, high = bounds[..., 0], bounds[..., 1]
        known = identifiable & np.isfinite(high).all(axis=1) & np.isfinite(true).all(axis=1)
        width = ((high - low)[known] / true[known]).ravel()
        rows.append({
            "quantity": key,
            "intervals": int(true.size),
            "hold": int(np.sum((low <= true) & (true <= high))),
            "above": int(np.sum(low > true)),
            "below": int(np.sum(high < true)),
            "identifiable": int(identifiable.sum()),
            "relative_width": float(np.median(width)) if width.size else None,
        })  # fmt: skip
    return rows


def main(out: Path, simulations: int = SIMULATIONS, scheduler: Scheduler = HERE, force: bool = False) -> None:
    """Simulate and measure.

    Args:
        out: where to write results.json, coverage.md and coverage.png.
        simulations: of each bench at each noise level.
        force: replace an existing result.
    """
    with hg.progress_bar("coverage") as progress:
        record = coverage_study(out, simulations, force, progress, scheduler.chosen)
    for row in record["rows"]:
        share = 100.0 * row["hold"] / row["intervals"]
        print(f"{row['bench']}, {row['level']}: {row['quantity']} {share:.1f} %")
    print(f"wrote {out / 'coverage.md'}")


if __name__ == "__main__":
    command(main)
