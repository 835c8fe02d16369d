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
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from statistics import NormalDist
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import hagoromo as hg
from hagoromo.backend import vectors
from hagoromo.recovery.choices import MatterChoice
from hagoromo.recovery.export import conserving
from studies.fuzzy_scenes import down, fur, fuzzy_simulated
from studies.real_captures import REAL
from studies.recover_scenes import (
    Shots,
    Simulated,
    Truth,
    aligned,
    around,
    misplaced,
    misstated,
    near_lamp,
    shots,
    simulated,
    standing,
)  # fmt: skip

Array = NDArray[np.float64]
SEED = 1
NEAR, FAR = (5.0, 60.0), (80.0, 110.0)  # ° off the eye, of lamps like those taken, and of those from the side
TWO_SIDED = NormalDist().inv_cdf(0.975)  # standard errors of a 95 % interval


@dataclass(frozen=True)
class Case:
    """A capture, and what is predicted from it. side: nodes. refine: what is estimated beside the object."""

    words: str
    taken: Callable[[], Simulated]
    side: int = 64
    refine: str = "none"


@dataclass(frozen=True)
class Row:
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
    return simulated(Truth(), given, SEED)


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
    "near": Case("36 views, a near lamp each, 5 to 60° off the eye", lambda: taken(shots(36, 5, 60, SEED))),
    "near128": Case("the same, 128 nodes", lambda: taken(shots(36, 5, 60, SEED)), 128),
    "six": Case("6 views × 6 lamps", lambda: taken(shots(6, 5, 60, SEED, lamps=6))),
    "twelve": Case("12 views only", lambda: taken(shots(12, 5, 60, SEED))),
    "flash": Case("36 views, a flash on the camera", lambda: taken(flash(36))),
    "dome": Case("12 views × 16 lamps", dome),
    "wrong": Case("the same, poses half a pixel and strengths 3 % wrong", wrong_dome),
    "refined": Case("the same, cameras and lamps refined", wrong_dome, refine="cameras,lamps"),
    "standing": Case("12 views, 8 near lamps that stand still", lamps_around),
    "elsewhere": Case("the same, each lamp 2 % of its distance elsewhere", lamps_elsewhere),
    "places": Case("the same, places refined", lamps_elsewhere, refine="places"),
}


@dataclass(frozen=True)
class FuzzyRow:
    """Scores of fuzzy matter. matter: the law that it was recovered by. new, far: see `Row`. box: how much worse its
    box shows the latter through `render` [dB].
    """

    case: str
    side: int
    matter: str
    new: float
    far: float
    box: float
    seconds: float


FUZZY_CASES: dict[str, tuple[Callable[[], hg.VolumeBox], MatterChoice]] = {
    "down_fuzzy": (down, "fuzzy"), "down_surface": (down, "surface"), "fur_fuzzy": (fur, "fuzzy"),
    "fur_surface": (fur, "surface"),
}  # fmt: skip
FUZZY_SIDE, FUZZY_STEPS, FUZZY_RAYS = 32, 60, 1 << 13  # of a recovery of fuzzy matter


@functools.cache
def fuzzy_captures(made: Callable[[], hg.VolumeBox]) -> tuple[Simulated, Simulated, Simulated]:
    """Photographs of a box with noise, and exact ones under new lamps like those, and from the side."""
    box = made()
    used = fuzzy_simulated(box, shots(36, 5, 60, SEED), SEED)
    new, far = shots(6, *NEAR, 2), shots(6, *FAR, 3)
    return used, fuzzy_simulated(box, new, noise=False), fuzzy_simulated(box, far, noise=False)


def measured_fuzzy(case: str) -> FuzzyRow:
    """Recover fuzzy matter from 36 views, a near lamp each, and compare it with six new views of each kind."""
    made, law = FUZZY_CASES[case]
    capture, new, far = fuzzy_captures(made)
    settings = hg.RecoverySettings(FUZZY_SIDE, FUZZY_STEPS, FUZZY_RAYS, keep=0, errors=False, matter=law)
    begin = time.process_time()
    found = hg.recover(capture.capture, settings)
    seconds, scores = time.process_time() - begin, (psnr(found, new), psnr(found, far))
    shown, peak = found.box(), max(float(exact.max()) for exact in far.exact)
    (_, dim), errors = conserving(found), []
    for p, exact in zip(far.capture.photographs, far.exact, strict=True):
        assert p.camera.response is not None
        lamps = tuple(replace(lamp, intensity=float(np.mean(lamp.intensity)) / dim) for lamp in p.lamps)
        image = hg.render(hg.Scene(p.camera, lamps, boxes=(shown,)), hg.Settings(samples=4))
        errors.append(np.mean((image.expose(p.camera.response) - exact) ** 2))
    through_box = float(10.0 * np.log10(peak**2 / np.mean(errors)))
    return FuzzyRow(case, FUZZY_SIDE, found.matter, *scores, scores[1] - through_box, seconds)


@functools.cache
def kept_aside(truth: Truth) -> tuple[Simulated, Simulated]:
    """Exact photographs of new views, under new lamps like those taken, and under lamps from the side."""
    return simulated(truth, shots(8, *NEAR, 2), noise=False), simulated(truth, shots(8, *FAR, 3), noise=False)


def measured(case: str, given: Case, aside: tuple[Simulated, Simulated], truth: Truth, **settings: Any) -> Row:
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
    material = record["material"]
    true = {"beta": truth.beta, "gamma": truth.gamma}
    held = all(material["interval_95"][k][0] <= v <= material["interval_95"][k][1] for k, v in true.items())
    edge = max(found.lattice.shape) * found.lattice.voxel
    scores, normals = [psnr(found, each) for each in aside], (float(angles.mean()), float(np.median(angles)))
    return Row(
        case, given.side, scores[0], scores[1], normals,
        100.0 * float(distances.mean()) / edge, 100.0 * (found.beta / truth.beta - 1.0),
        100.0 * (found.gamma / truth.gamma - 1.0), held, covered(found, shown, truth), seconds,
        str(record["cameras"]), str(record["strengths"]),
        (strengths_off(capture.photographs, photographed), strengths_off(found.photographs, photographed)),
        (places_off(capture.photographs, photographed), places_off(found.photographs, photographed)),
    )  # fmt: skip


def strengths_off(photographs: Sequence[hg.Photograph], photographed: Simulated) -> float:
    """Standard deviation of the logarithms of lamps' strengths over the true ones [%]."""
    pairs = zip(photographs, photographed.strengths, strict=True)
    return 100.0 * float(np.std([np.log(np.mean(p.lamps[0].intensity) / true) for p, true in pairs]))


def places_off(photographs: Sequence[hg.Photograph], photographed: Simulated) -> float:
    """How far the photographs' first lamps stand from where they are [mm], root mean square."""
    pairs = zip(photographs, photographed.places, strict=True)
    return 1e3 * float(np.sqrt(np.mean([np.sum((p.lamps[0].place - true) ** 2) for p, true in pairs])))


def psnr(found: hg.Recovered, aside: Simulated) -> float:
    """PSNR of all pictures together against exact light [dB]."""
    peak = max(float(exact.max()) for exact in aside.exact)
    errors = [
        np.mean((found.picture(p)[0] - exact) ** 2)
        for p, exact in zip(aside.capture.photographs, aside.exact, strict=True)
    ]
    return float(10.0 * np.log10(peak**2 / np.mean(errors)))


class Shown(NamedTuple):
    """True points of the surface (n, 3) [m], how far the one that was found is from them (n,) [m], and angles of its
    normals (n,) [°].
    """

    points: Array
    distances: Array
    angles: Array


def shape_errors(found: hg.Recovered, aside: Simulated) -> Shown:
    """The errors of the surface at the true points of all pictures."""
    there = [np.isfinite(normals[..., 0]) for normals in aside.normals]
    normals, points = (
        np.concatenate([each[which] for each, which in zip(all_of, there, strict=True)])
        for all_of in (aside.normals, aside.points)
    )
    at = places(found, points)
    slope = np.array(found.rendering.field.axis_at(at), np.float64).T
    slope /= np.linalg.norm(slope, axis=1, keepdims=True)
    angles = np.degrees(np.arccos(np.clip(np.einsum("ni,ni->n", slope, normals), -1.0, 1.0)))
    distances = np.abs(np.array(found.rendering.field.value_at(at), np.float64)) * found.lattice.voxel
    return Shown(points, distances, angles)


def places(found: hg.Recovered, points: Array) -> Any:
    """Points (n, 3) [m] as places of the lattice."""
    return vectors(found.lattice.from_world(points))


def covered(found: hg.Recovered, shown: Shown, truth: Truth) -> tuple[float, float, float] | None:
    """Share [%] of points of which 95 % intervals of position, normal and body colour hold the truth.

    The angle of a normal has two components: 95 % are within √(−ln 0.05) times its root of the mean square.
    """
    if found.errors is None:
        return None
    at, field = places(found, shown.points), found.rendering.field
    node = field.nearest_node(at)
    errors = found.errors
    position, normal = errors.position.ravel()[node], errors.normal.ravel()[node]
    colour = errors.colour.reshape(-1, 3)[node]
    true, own = (
        np.stack([np.array(c) for c in each], 1)
        for each in (truth.colours(vectors(shown.points)), field.colours_at(at))
    )
    held = (
        shown.distances < TWO_SIDED * position,
        np.radians(shown.angles) < np.sqrt(-np.log(0.05)) * normal,
        np.abs(own - true) < TWO_SIDED * colour,
    )
    return tuple(float(100.0 * each.mean()) for each in held)  # type: ignore[return-value]


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


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--only", nargs="*", default=[*CASES, *FUZZY_CASES])
    parser.add_argument("--data", type=Path, help="folder of real captures of unknown light")
    parser.add_argument("--real", nargs="*", default=list(REAL), choices=list(REAL), help="which of them")
    parser.add_argument("--refine", default="auto", help="of real captures: see `hagoromo recover`")
    parser.add_argument("--side", type=int, default=96, help="nodes for real captures")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    truth = Truth()
    rows: list[dict[str, Any]] = []
    for name in given.only:
        rows.append(
            asdict(
                measured_fuzzy(name) if name in FUZZY_CASES else measured(name, CASES[name], kept_aside(truth), truth)
            )
        )
        print(json.dumps(rows[-1]), flush=True)
    for name in given.real if given.data else ():
        rows.append(real(name, given.data, given.side, given.refine))
        print(json.dumps(rows[-1]), flush=True)
    hg.write_json(given.out / "recovery.json", {"rows": rows, "seed": SEED, "version": hg.__version__})


if __name__ == "__main__":
    main()
