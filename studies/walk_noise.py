"""The study of the noise that mode path is asked for: how often pictures keep it, what it costs, and their mean light.

    python -m studies.walk_noise examples/recipes --out out/noise

Every scene is rendered `runs` times with other seeds until the error that was asked for, and once with as many walks of
every pixel, to compare with. Enters: the recipes; walk_noise_before.json holds what the rule before gave. Leaves:
results.json and noise.md, which belongs to docs.
"""

from __future__ import annotations

import json
import math
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import tyro
from numpy.typing import NDArray

import hagoromo as hg
from studies.command import command
from studies.table import print_table
from studies.walk_noise_scenes import NoisyScene, noisy_scenes

BEFORE = Path(__file__).with_name("walk_noise_before.json")
RUNS = 100  # pictures of a scene with one error
TRUE_WALKS = 16384  # a pixel, of the picture that others are compared with
TRUE_SEED = 1 << 20
Record = dict[str, Any]


class TruePicture(NamedTuple):
    """Y (height, width), the variance that it still has, and which pixels show matter."""

    y: NDArray[np.float64]
    variance: NDArray[np.float64]
    matter: NDArray[np.bool_]

    @property
    def light(self) -> float:
        """Mean Y where there is matter."""
        return float(self.y[self.matter].mean())

    @property
    def standard_error(self) -> float:
        """Of that light, over it."""
        return math.sqrt(self.variance[self.matter].sum()) / float(self.y[self.matter].sum())

    def error(self, y: NDArray[np.float64]) -> float:
        """Root mean square error over the mean where there is matter, without what the truth itself is off by."""
        square = np.mean(((y - self.y) ** 2 - self.variance)[self.matter])
        return math.sqrt(max(float(square), 0.0)) / self.light


def walk_noise_study(
    recipes: Path, out: Path, runs: int = RUNS, force: bool = False, progress: hg.Progress = hg.silent
) -> Record:
    """The whole study, written to the folder `out`; gives the record of results.json."""
    with hg.whole_folder(out, force) as home:
        scenes, rows = noisy_scenes(recipes), []
        for number, each in enumerate(scenes):
            progress(number / len(scenes), each.name)
            rows += rows_of(each, runs)
        record = {"hagoromo": hg.__version__, "runs": runs, "true_walks": TRUE_WALKS, "rows": rows}
        hg.write_json(home / "results.json", record)
        before = json.loads(BEFORE.read_text(encoding="utf-8")) if BEFORE.exists() else record
        page = hg.page_text("walk_noise.md.j2", "studies", record=record, rows=paired(record, before))
        (home / "noise.md").write_text(page, encoding="utf-8", newline="\n")
        progress(1.0, "")
    return record


def rows_of(each: NoisyScene, runs: int) -> list[Record]:
    """A row for every error that the pictures of a scene are asked for."""
    truth = truth_of(each.scene)
    return [row(each, error, truth, runs) for error in each.errors]


def truth_of(scene: hg.Scene) -> TruePicture:
    """The picture of TRUE_WALKS walks through every pixel."""
    image = hg.render(scene, hg.Settings(samples=TRUE_WALKS, seed=TRUE_SEED), mode="path")
    assert image.variance is not None
    return TruePicture(luminance_of(image), image.variance.astype(float), image.alpha > 0.0)


def luminance_of(image: hg.Image) -> NDArray[np.float64]:
    """Y of every pixel."""
    return image.xyz()[..., 1].astype(float)


def row(each: NoisyScene, error: float, truth: TruePicture, runs: int) -> Record:
    """What `runs` pictures that are asked for one error have: shares, means and 95th percentiles, over that error."""
    found, stated, walks, seconds, light = [], [], [], [], []
    for seed in range(runs):
        start = time.process_time()
        image = hg.render(each.scene, hg.Settings(error=error, seed=seed), mode="path")
        seconds.append(time.process_time() - start)
        y = luminance_of(image)
        found.append(truth.error(y) / error)
        stated.append(image.metadata["noise"] / error)
        walks.append(image.metadata["walks"])
        light.append(float(y[truth.matter].mean()) / truth.light - 1.0)
    own = float(np.std(light, ddof=1)) / math.sqrt(runs)
    return {
        "scene": each.name, "asked": error, "kept": int(np.sum(np.array(found) <= 1.0)),
        "error": float(np.sqrt(np.mean(np.square(found)))), "error_95": float(np.quantile(found, 0.95)),
        "stated": float(np.mean(stated)), "walks": float(np.mean(walks)), "seconds": float(np.median(seconds)),
        "bias": float(np.mean(light)), "bias_error": math.hypot(own, truth.standard_error),
    }  # fmt: skip


def paired(record: Record, before: Record) -> list[tuple[Record, Record]]:
    """Rows, each with that of before."""
    known = {(row["scene"], row["asked"]): row for row in before["rows"]}
    return [(row, known[row["scene"], row["asked"]]) for row in record["rows"] if (row["scene"], row["asked"]) in known]


def main(recipes: tyro.conf.Positional[Path], out: Path, runs: int = RUNS, force: bool = False) -> None:
    """How often pictures of mode path keep the error that they are asked for.

    Args:
        recipes: the folder of the recipes.
        out: where to write results.json and noise.md.
        runs: pictures of every scene and error.
        force: replace an existing result.
    """
    with hg.progress_bar("noise of walks") as progress:
        record = walk_noise_study(recipes, out, runs, force, progress)
    columns = (
        "scene",
        "asked",
        f"kept of {record['runs']}",
        "error / asked",
        "95 %",
        "walks",
        "CPU [s]",
        "mean off by [%]",
    )
    rows = [
        [
            row["scene"], f"{row['asked']:g}", f"{row['kept']}", f"{row['error']:.2f}", f"{row['error_95']:.2f}",
            f"{row['walks']:.0f}", f"{row['seconds']:.2f}", f"{100 * row['bias']:+.2f} ± {100 * row['bias_error']:.2f}",
        ]
        for row in record["rows"]
    ]  # fmt: skip
    print_table("The error that was asked for", columns, rows)
    print(f"wrote {out / 'noise.md'}")


if __name__ == "__main__":
    command(main)
