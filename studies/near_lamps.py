"""The study of near lamps: simulated photographs of known surfaces, for every width of highlight, against the truth.

    python -m studies.near_lamps --out out/near_lamps.json [--leds ../shared/data/near_ps_leds]

Enters: a rig, its own or the calibrated LEDs of near_ps_leds. Leaves: mean and median error of the normals, of the
depth, and how far the stated variances hold, by surface, γ and bits.
"""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np

import hagoromo as hg
from hagoromo.app.shared_options import HERE, Scheduler
from hagoromo.cluster.cluster import mapped
from studies.command import command
from studies.near_rig import SURFACE_DISTANCE, Finish, NearRig, read_rig, ring_rig, simulate, sphere, waves

GAMMAS = (0.05, 0.1, 0.2, 0.35, 0.5)
SURFACES = {"ball": sphere, "waves and a step": waves}
GUESS = 1.04  # start of the search, as a multiple of the true distance


def study_case(rig: NearRig, surface: str, look: Finish, bits: int) -> dict[str, Any]:
    """One case: errors of normals [°] and depth [mm], and the median of error² over variance, 1 where it is honest."""
    capture, truth = simulate(rig, SURFACES[surface], look, bits)
    shape = hg.solve_shape(capture, GUESS * SURFACE_DISTANCE)
    pixels, fit = shape.normal_map.views, shape.normal_map.fit
    true = truth.normals[pixels.rows, pixels.columns]

    def error(normals: np.ndarray) -> np.ndarray:
        return np.degrees(np.arccos(np.clip(np.einsum("pi,pi->p", normals, true), -1.0, 1.0)))

    off, plain = error(fit.normals), error(hg.least_squares_lambert(pixels)[0])
    missed = 1e3 * (shape.surface.points - truth.points)[pixels.rows, pixels.columns, 2]
    return {
        "surface": surface, "gamma": look.gamma, "bits": bits, "interreflection": look.interreflection,
        "mean_deg": float(off.mean()), "median_deg": float(np.median(off)),
        "least_squares_on_the_same_surface_deg": float(plain.mean()),
        "depth_median_mm": float(np.median(np.abs(missed))), "depth_95_mm": float(np.percentile(np.abs(missed), 95)),
        "error_over_variance": float(np.median(np.radians(off) ** 2 / fit.variance) / np.log(2.0)),
        "rounds": shape.rounds,
    }  # fmt: skip


def studied(
    rig: NearRig, scheduler: str | int | None = None, progress: hg.Progress = hg.silent
) -> list[dict[str, Any]]:
    """Every case. scheduler: see `hg.render`."""
    looks = zip(itertools.product(SURFACES, GAMMAS), itertools.cycle((12, 8, 10)), strict=False)
    tasks = [(rig, surface, Finish(gamma, interreflection=bits == 8), bits) for (surface, gamma), bits in looks]
    names = [f"{surface}, γ {look.gamma:g}" for _, surface, look, _ in tasks]
    return mapped(study_case, tasks, scheduler, progress, names)


def main(
    out: Path, leds: Path | None = None, smaller: float = 20.0, scheduler: Scheduler = HERE, force: bool = False
) -> None:
    """Run every case and write the table.

    Args:
        out: JSON file to write.
        leds: folder near_ps_leds; without it a made-up ring of ten LEDs.
        smaller: how much smaller than the camera's the photographs under `leds` are.
        force: replace an existing result.
    """
    rig = ring_rig() if leds is None else read_rig(leds, smaller)
    with hg.whole_file(out, force) as partial, hg.progress_bar("near lamps") as progress:
        cases = studied(rig, scheduler.chosen, progress)
        hg.write_json(partial, {"rig": "ring" if leds is None else "near_ps_leds", "cases": cases})
    for case in cases:
        print({key: round(value, 3) if isinstance(value, float) else value for key, value in case.items()})
    print(f"wrote {out}")


if __name__ == "__main__":
    command(main)
