"""Time at equal error: the march now against version 0.2.0, on the ball of the peers under one lamp.

Enters: BEFORE, what 0.2.0 gave, measured as follows. In one process its `render` of the scene (512² pixels, every frame
with medium and maps made anew) took turns with a yardstick that has no code of ours: Numba's march of the same ball in
64² pixels, half a voxel a step (peers_numba.py). Both in CPU time of the process, medians of five rounds. Here the
yardstick takes turns with our frames, so what is compared is times over that of the yardstick. Errors are those of the
peers: root mean square over that of the reference, where there is matter. What our frames take at the error of a row of
BEFORE is read off the straight line between two of our settings, in logarithms. ROUGH_BEFORE is the same of rough
matter under three lamps that move (rough_scenes.py), each error against a fine march of its own version. Feather, hair
and wing of 0.2.0 had the present voxels, opaque and of one reflectance. Leaves: out/bench/equal_error.json.

    python benchmarks/equal_error.py [--rounds 5]
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from peers_hagoromo import prepared, reference
from peers_numba import frames as numba_frames
from peers_scene import STUDIES, PeerScene, make_matter
from rough_scenes import built, cpu_seconds, numba_yardstick, rough
from rough_scenes import measured as rough_times
from turns import medians, options, record

import hagoromo as hg
from hagoromo.image.scene.modes import Shadows

BEFORE = (  # shadows, tolerance, time over that of the yardstick, relative error
    ("map", 0.16, 0.525, 0.02292),
    ("map", 0.08, 0.713, 0.01306),
    ("map", 0.04, 1.058, 0.00777),
    ("map", 0.02, 1.737, 0.00433),
    ("march", 0.16, 1.835, 0.01869),
    ("march", 0.04, 7.098, 0.00512),
    ("march", 0.02, 14.622, 0.00266),
)
# rough matter by 0.2.0, maps of its own choice, over the yardstick: 2026-11-27, Intel(R) Xeon(R) Processor, 2 cores
# that other programs used, too (load 3 to 8). Cloth was measured on 2026-11-28, but for the times of linen, against
# marches that read the level of each sample's texel, as those of today do: 0.2.0 itself read the finest one
ROUGH_BEFORE = (  # scene, shadows, tolerance, time over that of the yardstick, relative error
    ("noisy ball", "map", 0.16, 0.804, 0.03601),
    ("noisy ball", "map", 0.08, 1.215, 0.01886),
    ("noisy ball", "map", 0.04, 1.879, 0.01391),
    ("noisy ball", "map", 0.02, 3.328, 0.00899),
    ("skin", "map", 0.16, 0.594, 0.02560),
    ("skin", "map", 0.08, 0.826, 0.01281),
    ("skin", "map", 0.04, 1.221, 0.00760),
    ("skin", "map", 0.02, 2.102, 0.00411),
    ("primary", "map", 0.16, 0.544, 0.04609),
    ("primary", "map", 0.08, 0.740, 0.03849),
    ("primary", "map", 0.04, 1.020, 0.01785),
    ("primary", "map", 0.02, 1.501, 0.00753),
    ("hair", "map", 0.16, 0.753, 0.03481),
    ("hair", "map", 0.08, 1.073, 0.02226),
    ("hair", "map", 0.04, 1.601, 0.01516),
    ("hair", "map", 0.02, 2.592, 0.01037),
    ("wing", "map", 0.16, 0.644, 0.15723),
    ("wing", "map", 0.08, 0.953, 0.08615),
    ("wing", "map", 0.04, 1.321, 0.04704),
    ("wing", "map", 0.02, 2.241, 0.02190),
    ("linen", "map", 0.16, 2.223, 0.13673),
    ("linen", "map", 0.08, 2.506, 0.13370),
    ("linen", "map", 0.04, 2.773, 0.13281),
    ("linen", "map", 0.02, 3.333, 0.13275),
    ("satin", "map", 0.16, 1.227, 0.06737),
    ("satin", "map", 0.08, 1.376, 0.05810),
    ("satin", "map", 0.04, 1.655, 0.05298),
    ("satin", "map", 0.02, 2.041, 0.05202),
    ("stockinette", "map", 0.16, 6.005, 0.09158),
    ("stockinette", "map", 0.08, 6.044, 0.08597),
    ("stockinette", "map", 0.04, 6.974, 0.08504),
    ("stockinette", "map", 0.02, 8.010, 0.08488),
)
ROUGH_TOLERANCES = 0.64, 0.32, 0.16, 0.08, 0.04, 0.02
TOLERANCES: dict[Shadows, tuple[float, ...]] = {
    "map": (0.64, 0.32, 0.16, 0.08, 0.04, 0.02),
    "march": (0.64, 0.32, 0.16, 0.08, 0.04),
}
YARDSTICK = "step 0.5 voxel"


def main() -> None:
    """Time our settings and the yardstick in turn, and set them beside what 0.2.0 gave."""
    rounds = options(__doc__, 5).parse_args().rounds
    with tempfile.TemporaryDirectory() as name:
        make_matter(Path(name))
        study = {s.name: s for s in STUDIES}
        scene, small = (PeerScene(study[ball], Path(name)) for ball in ("ball, 1 lamp", "ball, 1 lamp, 64 px"))
        own = measured(scene, numba_frames(small)[YARDSTICK], rounds)
    rows = [against(own, *row) for row in BEFORE]
    rough_rows, rough_own = against_in_rough_matter(rounds)
    for row in (*rows, *rough_rows):
        print(row)
    figures = {"rounds": rounds, "own": own, "rows": rows, "rough": rough_rows, "rough_own": rough_own}
    record("equal_error", figures)


def against_in_rough_matter(rounds: int) -> tuple[list[dict[str, Any]], dict[str, list[dict[str, Any]]]]:
    """Rows of ROUGH_BEFORE beside our times at their errors, and our own rows by scene; see rough_scenes.py."""
    yardstick, settings = numba_yardstick(), [hg.Settings(tolerance=each) for each in ROUGH_TOLERANCES]
    names = dict.fromkeys(row[0] for row in ROUGH_BEFORE)
    own = {name: rough_times(rough(name, built(name)), settings, yardstick, rounds) for name in names}
    rows = [
        {"scene": name, **against(own[name], shadows, tolerance, taken, error)}
        for name, shadows, tolerance, taken, error in ROUGH_BEFORE
    ]
    return rows, own


def measured(scene: PeerScene, yardstick: Callable[[], Any], rounds: int) -> list[dict[str, Any]]:
    """Time over that of the yardstick, and error, of all settings of ours."""
    ready, (true, matter) = prepared(scene), reference(scene)
    settings = [hg.Settings(shadows=shadows, tolerance=t) for shadows, each in TOLERANCES.items() for t in each]
    frames: dict[Any, Callable[[], Any]] = {
        (one.shadows, one.tolerance): lambda one=one: hg.render(ready, one) for one in settings
    }
    pictures = {key: scene.sampled(frame().weights[..., 0])[matter] for key, frame in frames.items()}
    yardstick()
    times: dict[Any, list[float]] = {key: [] for key in (*frames, YARDSTICK)}
    for _ in range(rounds):
        for key, frame in frames.items():
            times[YARDSTICK].append(cpu_seconds(yardstick))
            times[key].append(cpu_seconds(frame))
    middle, size = medians(times), float(np.sqrt(np.mean(true[matter] ** 2)))
    return [
        {
            "shadows": key[0], "tolerance": key[1], "time": middle[key] / middle[YARDSTICK],
            "error": float(np.sqrt(np.mean((seen - true[matter]) ** 2))) / size,
        }
        for key, seen in pictures.items()
    ]  # fmt: skip


def against(
    own: list[dict[str, Any]], shadows: str, tolerance: float, taken: float, error: float
) -> dict[str, float | str]:
    """A row of BEFORE beside what our frames with the same shadows take at its error, on the line between two of them;
    at an error larger than all of ours, what the least accurate takes.
    """
    rows = sorted((row for row in own if row["shadows"] == shadows), key=lambda row: row["error"])
    errors, times = (np.log([row[key] for row in rows]) for key in ("error", "time"))
    now = float(np.exp(np.interp(np.log(error), errors, times)))
    return {
        "shadows": shadows, "tolerance": tolerance, "error": error, "before": taken, "now": now, "ratio": taken / now,
    }  # fmt: skip


if __name__ == "__main__":
    main()
