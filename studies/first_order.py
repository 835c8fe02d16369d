"""The study of the first order: the march against an independent oracle of eq. (2)–(12) in float64, and closed forms.

    python -m studies.first_order --out out/first_order

Enters: nothing; first_order_before.json holds what version 0.2.0 gave. Leaves: results.json, first_order.md,
first_order.png and first_order_maps.png, which belong to docs.
"""

from __future__ import annotations

import json
import math
import statistics
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import hagoromo as hg
from hagoromo.image.scene.modes import Shadows
from hagoromo.transport.frames import DEFAULT_TOLERANCE, LONGEST_STEP
from studies.command import command
from studies.first_order_page import write_first_order_page
from studies.table import print_table
from tests.oracle.blocks import DEPTHS, FACES, HEIGHTS, error_and_ratio_by_lamp, light_over_closed_form
from tests.oracle.lattice import Array
from tests.oracle.scenes import OracleCase, cases, error_and_ratio

BEFORE = Path(__file__).with_name("first_order_before.json")
SHADOWS = ("march", "map")
TOLERANCES = (0.04, 0.01, 0.0025)
PICTURED = (
    "hard ball",
    "noisy slab of depth 50",
    "threads",
    "two equal boxes in one place",
    "block, 1 depth a voxel, lamp at 5°",
)
GREEN = 1  # place of 550 nm among the oracle's wavelengths
TIMED = 5  # frames of a scene, of which the median time counts


def first_order_study(out: str | Path, force: bool = False, progress: hg.Progress = hg.silent) -> dict[str, Any]:
    """The whole study, written to the folder `out`; gives the record of results.json."""
    with hg.whole_folder(out, force) as home:
        scenes, rows, pictures = cases(), [], {}
        for number, case in enumerate(scenes):
            progress(0.8 * number / len(scenes), case.name)
            true, transmittance = case.truth()
            for shadows in SHADOWS:
                rows += [scene_row(case, true, transmittance, shadows, tolerance) for tolerance in TOLERANCES]
            if case.name in PICTURED:
                pictures[case.name] = picture(case, true)
        progress(0.8, "homogeneous blocks")
        record = {
            "hagoromo": hg.__version__, "rows": rows, "blocks": block_rows(), "pictures": pictures,
            "longest_step_voxel": longest_steps(),
        }  # fmt: skip
        hg.write_json(home / "results.json", record)
        before = json.loads(BEFORE.read_text(encoding="utf-8")) if BEFORE.exists() else record
        write_first_order_page(home, record, before)
        progress(1.0, "")
    return record


def longest_steps() -> dict[str, float]:
    """Greatest length of a step at each tolerance [voxel]."""
    return {str(t): LONGEST_STEP * math.sqrt(t / DEFAULT_TOLERANCE) for t in TOLERANCES}


def scene_row(
    case: OracleCase, true: Array, transmittance: Array, shadows: Shadows, tolerance: float
) -> dict[str, Any]:
    """Error and ratio of the means of one scene where there is matter, and the median time of a frame [s]."""
    settings, seconds = hg.Settings(shadows=shadows, tolerance=tolerance), []
    seen = case.seen(settings)
    for _ in range(TIMED):
        start = time.perf_counter()
        case.seen(settings)
        seconds.append(time.perf_counter() - start)
    error, ratio = error_and_ratio(seen, true, transmittance)
    return {
        "scene": case.name, "shadows": shadows, "tolerance": tolerance, "error": _short(error),
        "ratio": round(ratio, 5), "seconds": _short(statistics.median(seconds)),
    }  # fmt: skip


def block_rows() -> list[dict[str, Any]]:
    """Error and ratio of the means of homogeneous blocks, lamp by lamp, against their closed form."""
    rows = []
    for depth in DEPTHS:
        for face in FACES:
            for shadows in SHADOWS:
                seen = light_over_closed_form(depth, face, hg.Settings(shadows=shadows))
                for height, *figures in zip(HEIGHTS, *error_and_ratio_by_lamp(seen), strict=True):
                    error, ratio = (_short(float(figure)) for figure in figures)
                    rows.append(
                        {
                            "depth": depth,
                            "face": face,
                            "shadows": shadows,
                            "height": height,
                            "error": error,
                            "ratio": ratio,
                        }
                    )
    return rows


def picture(case: OracleCase, true: Array) -> dict[str, list[float]]:
    """A scene at 550 nm as the oracle sees it and as the march with shadow maps does, over the mean: pixels in rows."""
    seen, mean = case.seen(hg.Settings())[:, GREEN], true[:, GREEN].mean()
    return {"true": _rounded(true[:, GREEN] / mean), "seen": _rounded(seen / mean)}


def _rounded(values: Sequence[float]) -> list[float]:
    return [round(float(value), 4) for value in values]


def _short(value: float) -> float:
    return float(f"{value:.4g}")


def main(out: Path, force: bool = False) -> None:
    """Compare the march with the oracle.

    Args:
        out: where to write results.json, first_order.md and the pictures.
        force: replace an existing result.
    """
    with hg.progress_bar("first order") as progress:
        record = first_order_study(out, force, progress)
    rows = [
        [
            row["scene"], row["shadows"], f"{row['tolerance']:g}", f"{100 * row['error']:.3f} %", f"{row['ratio']:.4f}",
            f"{1e3 * row['seconds']:.1f} ms", f"{record['longest_step_voxel'][str(row['tolerance'])]:g}",
        ]
        for row in record["rows"]
    ]  # fmt: skip
    columns = ("scene", "shadows", "tolerance", "error over mean", "mean ratio", "a frame", "longest step [voxel]")
    print_table("The march against the oracle", columns, rows)
    print(f"wrote {out / 'first_order.md'}")


if __name__ == "__main__":
    command(main)
