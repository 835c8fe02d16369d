"""Recovery: boxes recovered from simulated and real photographs, against photographs that were kept aside.

    python -m studies.recovery --out out/recovery [--data FOLDER] [--only NAME …] [--real NAME …]

Every score is unscaled, of linear values: over all valid pixels, and inside the silhouettes. The simulated ones are
against exact light. Outside a stated mask a photograph counts as black. Timings are processor seconds.
"""

from __future__ import annotations

import argparse
import functools
import json
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import hagoromo as hg
from hagoromo.backend import vectors
from studies.fuzzy_recovery import FAR, FUZZY_CASES, NEAR, SEED, measured_fuzzy
from studies.gloss_recovery import GLOSS_CASES, measured_gloss
from studies.path_scenes import path_simulated, scanned
from studies.real_captures import REAL
from studies.recover_scenes import (
    Shots,
    Simulated,
    TrueObject,
    aligned,
    around,
    misplaced,
    misstated,
    near_lamp,
    shots,
    simulated,
    standing,
)  # fmt: skip
from studies.recovery_scores import covered, gloss_held, places_off, psnr, shape_errors, strengths_off

Array = NDArray[np.float64]
SCAN = "meshes_volumes/lucy.ply"  # a scanned mesh, in the folder of data


@dataclass(frozen=True)
class RecoveryCase:
    """A capture, and what is predicted from it. side: nodes. refine: what is estimated beside the object."""

    words: str
    taken: Callable[[], Simulated]
    side: int = 64
    refine: str = "none"


@dataclass(frozen=True)
class RecoveryRow:
    """Scores of a case. new, far: PSNR of new views under lamps like those taken, and under lamps from the side [dB].
    normals: mean and median error [°]. surface: mean distance of true points from the surface, % of the lattice's edge.
    beta, gamma: error [%]. held: whether both are in their 95 % intervals. covered: share [%] of the true points, of
    which 95 % intervals of position, normal and body colour hold the truth; None where errors are not stated. cameras,
    strengths: what was found of them. strengths_off: standard deviation [%] of lamps' strengths over the true ones, as
    stated and as found. places_off: how far lamps stand from where they are [mm], root mean square, likewise.
    """

    case: str
    side: int
    new: float
    far: float
    normals: tuple[float, float]
    surface: float
    beta: float
    gamma: float
    held: bool
    covered: tuple[float, float, float] | None
    seconds: float
    cameras: str
    strengths: str
    strengths_off: tuple[float, float]
    places_off: tuple[float, float]


def flash(count: int) -> Shots:
    """Views with a flash 1° from the lens."""
    random = np.random.default_rng(SEED)
    views = around(count, turn=0.7)
    return Shots(views, [near_lamp(v, 1.0, 1.0, random)[None] for v in views])


def taken(given: Shots) -> Simulated:
    """Photographs of the object, with noise."""
    return simulated(TrueObject(), given, SEED)


def dome() -> Simulated:
    """12 views, each under 16 lamps."""
    return taken(shots(12, 5, 60, SEED, lamps=16))


def wrong_dome() -> Simulated:
    """The same with poses that are half a pixel wrong and lamps 3 % too strong or too weak."""
    return misstated(dome(), 0.5, 0.03, SEED)


def lamps_around() -> Simulated:
    """12 views under 8 lamps that stand still around the object: those that shine on what a view shows."""
    return taken(standing(12, 8))


def lamps_elsewhere() -> Simulated:
    """The same with each lamp stated 2 % of its distance elsewhere."""
    return misplaced(lamps_around(), 0.02, SEED)


CASES = {
    "near": RecoveryCase("36 views, a near lamp each, 5 to 60° off the eye", lambda: taken(shots(36, 5, 60, SEED))),
    "near48": RecoveryCase("the same, 48 nodes", lambda: taken(shots(36, 5, 60, SEED)), 48),
    "near128": RecoveryCase("the same, 128 nodes", lambda: taken(shots(36, 5, 60, SEED)), 128),
    "six": RecoveryCase("6 views × 6 lamps", lambda: taken(shots(6, 5, 60, SEED, lamps=6))),
    "twelve": RecoveryCase("12 views only", lambda: taken(shots(12, 5, 60, SEED))),
    "flash": RecoveryCase("36 views, a flash on the camera", lambda: taken(flash(36))),
    "dome": RecoveryCase("12 views × 16 lamps", dome),
    "wrong": RecoveryCase("the same, poses half a pixel and strengths 3 % wrong", wrong_dome),
    "refined": RecoveryCase("the same, cameras and lamps refined", wrong_dome, refine="cameras,lamps"),
    "standing": RecoveryCase("12 views, 8 near lamps that stand still", lamps_around),
    "elsewhere": RecoveryCase("the same, each lamp 2 % of its distance elsewhere", lamps_elsewhere),
    "places": RecoveryCase("the same, places refined", lamps_elsewhere, refine="places"),
}


@functools.cache
def kept_aside(truth: TrueObject) -> tuple[Simulated, Simulated]:
    """Exact photographs of new views, under new lamps like those taken, and under lamps from the side."""
    return simulated(truth, shots(8, *NEAR, 2), noise=False), simulated(truth, shots(8, *FAR, 3), noise=False)


def measured(
    case: str, given: RecoveryCase, aside: tuple[Simulated, Simulated], truth: TrueObject, **settings: Any
) -> RecoveryRow:
    """Recover a case and compare it with what is kept aside."""
    photographed = given.taken()
    capture = photographed.capture
    begin = time.process_time()
    found = hg.recover(capture, hg.RecoverySettings(side=given.side, keep=0, refine=given.refine, **settings))
    seconds = time.process_time() - begin
    if photographed.cameras:
        cameras = [p.camera for p in found.photographs]
        aside = aligned(aside[0], photographed.cameras, cameras), aligned(aside[1], photographed.cameras, cameras)
    shown = shape_errors(found, aside[0])
    angles, distances = shown.angles, shown.distances
    record = found.record()
    colours = np.stack([np.array(each) for each in truth.colours(vectors(shown.points))], 1)
    edge = max(found.lattice.shape) * found.lattice.voxel
    scores, normals = [psnr(found, each) for each in aside], (float(angles.mean()), float(np.median(angles)))
    return RecoveryRow(
        case, given.side, scores[0], scores[1], normals,
        100.0 * float(distances.mean()) / edge, 100.0 * (found.beta / truth.beta - 1.0),
        100.0 * (found.gamma / truth.gamma - 1.0), gloss_held(found, truth.beta, truth.gamma),
        covered(found, shown, colours), seconds,
        str(record["cameras"]), str(record["strengths"]),
        (strengths_off(capture.photographs, photographed), strengths_off(found.photographs, photographed)),
        (places_off(capture.photographs, photographed), places_off(found.photographs, photographed)),
    )  # fmt: skip


def real(name: str, data: Path, side: int, refine: Any, keep: int = 8) -> dict[str, Any]:
    """A real capture of unknown light: every `keep`-th view is predicted, from nothing that it shows itself."""
    begin = time.process_time()
    try:
        found = hg.recover(REAL[name](data), hg.RecoverySettings(side=side, keep=keep, refine=refine))
    except hg.InputError as error:
        return {"case": name, "refused": str(error)}
    seconds, scores, record = time.process_time() - begin, found.scores(), found.record()
    return {
        "case": name, "side": side, "views": len(found.photographs), "aside": len(scores),
        "psnr": float(np.mean([s.psnr for s in scores])), "inside": float(np.mean([s.inside for s in scores])),
        **{key: record[key] for key in ("silhouettes", "lamps", "lights_tried_db", "cameras")}, "seconds": seconds,
    }  # fmt: skip


@dataclass(frozen=True)
class ScanRow:
    """Scores of a scanned mesh, see `RecoveryRow`: PSNR over all pixels."""

    case: str
    side: int
    new: float
    far: float
    seconds: float


def measured_scan(file: Path, side: int, pixels: int = 96) -> ScanRow:
    """Recover a mesh that Mitsuba's path tracer lit, from 36 views, a near lamp each, and predict six of each kind."""
    mesh = scanned(file)
    used = path_simulated(mesh, shots(36, *NEAR, SEED, pixels), SEED)
    new, far = (
        path_simulated(mesh, shots(6, *lamps, seed, pixels), 100 * seed, noise=False)
        for lamps, seed in ((NEAR, 2), (FAR, 3))
    )
    begin = time.process_time()
    found = hg.recover(used.capture, hg.RecoverySettings(side=side, keep=0, errors=False))
    return ScanRow("scan", side, psnr(found, new), psnr(found, far), time.process_time() - begin)


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--only", nargs="*", default=[*CASES, *FUZZY_CASES, *GLOSS_CASES])
    parser.add_argument("--data", type=Path, help="folder of real captures of unknown light")
    parser.add_argument("--real", nargs="*", default=list(REAL), choices=list(REAL), help="which of them")
    parser.add_argument("--refine", default="auto", help="of real captures: see `hagoromo recover`")
    parser.add_argument("--side", type=int, default=96, help="nodes for real captures")
    parser.add_argument("--scan", type=int, default=64, help="nodes for the scanned mesh; 0: none")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    truth = TrueObject()
    rows: list[dict[str, Any]] = []
    for name in given.only:
        if name in FUZZY_CASES:
            rows.append(asdict(measured_fuzzy(name)))
        elif name in GLOSS_CASES:
            rows.append(asdict(measured_gloss(name)))
        else:
            rows.append(asdict(measured(name, CASES[name], kept_aside(truth), truth)))
        print(json.dumps(rows[-1]), flush=True)
    if given.data and given.scan:
        rows.append(asdict(measured_scan(given.data / SCAN, given.scan)))
        print(json.dumps(rows[-1]), flush=True)
    for name in given.real if given.data else ():
        rows.append(real(name, given.data, given.side, given.refine))
        print(json.dumps(rows[-1]), flush=True)
    hg.write_json(given.out / "recovery.json", {"rows": rows, "seed": SEED, "version": hg.__version__})


if __name__ == "__main__":
    main()
