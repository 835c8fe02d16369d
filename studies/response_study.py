"""The study of calibrated responses: 28 cameras, known lights or a chart, 1 % noise; the fit against one that cheats.

    python -m studies.response_study ../shared/data --out out/response

The rival is a smooth non-negative fit whose smoothing is chosen with knowledge of the truth. Each camera is left out of
the mean of published cameras that its fit may use. The other constants of our fit were chosen over these cameras, most
of them over every other one from the first on. Then readings with faults: `studies.response_faults`.
Leaves: results.json, response.md, response.png.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from tyro.conf import Positional

import hagoromo as hg
from hagoromo.app.shared_options import HERE, Scheduler
from hagoromo.calibration.response.calibrate_response import overlap_matrix, solve_response
from hagoromo.cluster.cluster import mapped
from studies.command import command
from studies.response_bench import (
    CURVE_WAVELENGTHS,
    LEAST_PEAK_SHARE,
    READING_NOISE,
    Array,
    chart_under,
    correlation,
    known_lights,
    priors_without,
    summary,
)
from studies.response_faults import fault_cases, fault_score, time_of_many
from studies.response_page import write_response_page
from studies.spectra_bench import CAMERAS, OTHERS, read_cameras, read_rawtoaces
from studies.table import print_table

PENALTIES = np.logspace(-6, 1, 22)  # of the rival, relative to the scale of its equations
CHART_LAMPS = (("D65",), ("A",), ("D65", "A"), ("D65", "FL11"))


def response_study(
    folder: str | Path,
    out: str | Path,
    every: int = 1,
    force: bool = False,
    progress: hg.Progress = hg.silent,
    scheduler: str | int | None = None,
    first: int = 0,
) -> dict[str, Any]:
    """The study over every n-th camera from `first` on, written to `out`; gives the record of results.json.

    scheduler: see `hg.render`.
    """
    with hg.whole_folder(out, force) as home:
        cameras = dict(list(read_cameras(Path(folder) / CAMERAS).items())[first::every])
        lights = known_lights()
        designs = {
            "115 lights, tabulated every 10 nm": lights @ overlap_matrix(CURVE_WAVELENGTHS),
            "115 lights, sums over the table": lights,
            **{f"chart under {' and '.join(lamps)}": chart_under(lamps) for lamps in CHART_LAMPS},
        }
        tasks = {name: (matrix, cameras) for name, matrix in designs.items()}
        others = read_rawtoaces(Path(folder) / OTHERS)
        for name in list(designs)[:2] if others else []:
            tasks[f"{name}, {len(others)} of rawtoaces"] = designs[name], others
        scores = mapped(score, list(tasks.values()), scheduler, hg.part_of(progress, 0.0, 0.4), list(tasks))
        rows = dict(zip(tasks, scores, strict=True))
        record = {
            "hagoromo": hg.__version__, "noise": READING_NOISE, "cameras": list(cameras), "rows": rows,
            "faults": faults(cameras, hg.part_of(progress, 0.4, 0.5), scheduler),
            "cpu_s": time_of_many(next(iter(cameras.values()))),
        }  # fmt: skip
        hg.write_json(home / "results.json", record)
        write_response_page(home, record)
        progress(1.0, "")
    return record


def faults(
    cameras: Mapping[str, hg.Response], progress: hg.Progress, scheduler: str | int | None
) -> dict[str, dict[str, Any]]:
    """What was read → case → how well curves are known from readings with that fault."""
    cases = fault_cases()
    every = [case for group in cases.values() for case in group]
    names = [case.name for case in every]
    scores = iter(mapped(fault_score, [(case, cameras) for case in every], scheduler, progress, names))
    return {name: {case.name: next(scores) for case in group} for name, group in cases.items()}


def score(matrix: Array, cameras: Mapping[str, hg.Response], seed: int = 0) -> dict[str, Any]:
    """Correlation with the true curves (median, 10th percentile), ours and the rival's, and coverage, per channel."""
    random = np.random.default_rng(seed)
    ours, rival, inside, bright = [], [], [], []
    for camera in cameras.values():
        true = np.array([camera.curve(channel).at(CURVE_WAVELENGTHS) for channel in range(3)])
        exact = true @ matrix.T
        readings = exact * (1.0 + READING_NOISE * random.standard_normal(exact.shape))
        priors = partial(priors_without, camera)
        calibration = solve_response(CURVE_WAVELENGTHS, matrix, dict(zip("RGB", readings, strict=True)), priors)
        bounds = np.moveaxis(calibration.interval_95, 1, 0)
        held = (true >= bounds[..., 0]) & (true <= bounds[..., 1])
        ours.append([correlation(*pair) for pair in zip(calibration.response.values.T, true, strict=True)])
        rival.append([_cheating(matrix, *pair) for pair in zip(readings, true, strict=True)])
        inside.append(held.mean(axis=1))
        bright.append(held[true > LEAST_PEAK_SHARE * true.max(axis=1, keepdims=True)].mean())
    return {
        "correlation": summary(np.array(ours)),
        "correlation_knowing_the_truth": summary(np.array(rival)),
        "coverage": dict(zip("RGB", np.mean(inside, axis=0).tolist(), strict=True)),
        "coverage_above_5_percent": float(np.mean(bright)),
    }


def _cheating(matrix: Array, reading: Array, true: Array) -> float:
    """The best correlation of a non-negative fit with a penalty on second differences, over all penalties."""
    from scipy.optimize import nnls

    lit = reading > 0.0
    equations = matrix[lit] / reading[lit, None]
    bend = np.diff(np.eye(len(true)), 2, axis=0) * np.abs(equations).max()
    right = np.concatenate([np.ones(lit.sum()), np.zeros(len(bend))])
    curves = [nnls(np.concatenate([equations, weight * bend]), right, maxiter=10000)[0] for weight in PENALTIES]
    return max(correlation(curve, true) for curve in curves)


def main(
    folder: Positional[Path],
    out: Path,
    first: int = 0,
    every: int = 1,
    scheduler: Scheduler = HERE,
    force: bool = False,
) -> None:
    """Study calibrated responses with the cameras in FOLDER.

    Args:
        folder: with camera_sensitivities/camspec_28_cameras.csv.
        out: folder to write.
        first: number of the first camera, from 0.
        every: take every n-th camera from there.
        force: replace an existing result.
    """
    with hg.progress_bar("responses") as progress:
        record = response_study(folder, out, every, force, progress, scheduler.chosen, first)
    title = "Correlation with the true curve, median / 10th percentile, and coverage of 95 % intervals"
    fits = {"hagoromo": "correlation", "knowing the truth": "correlation_knowing_the_truth"}
    rows = [[name, fit, *_cells(row, key)] for name, row in record["rows"].items() for fit, key in fits.items()]
    print_table(title, ("readings", "fit", "R", "G", "B"), rows)
    print(f"wrote {out / 'response.md'}")


def _cells(row: dict[str, Any], key: str) -> list[str]:
    cells = [f"{of['median']:.4f} / {of['p10']:.4f}" for of in row[key].values()]
    if key == "correlation":
        shares = row["coverage"].values()
        cells = [f"{cell} · {100 * share:.0f} %" for cell, share in zip(cells, shares, strict=True)]
    return cells


if __name__ == "__main__":
    command(main)
