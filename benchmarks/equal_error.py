"""Time at equal error: the march now against version 0.2.0, on the ball of the peers under one lamp.

Enters: BEFORE, what 0.2.0 gave, measured as follows. In one process its `render` of the scene (512² pixels, every frame
with medium and maps made anew) took turns with a yardstick that has no code of ours: Numba's march of the same ball in
64² pixels, half a voxel a step (peers_numba.py). Both in CPU time of the process, medians of five rounds. Here the
yardstick takes turns with our frames, so what is compared is times over that of the yardstick. Errors are those of the
peers: root mean square over that of the reference, where there is matter. What our frames take at the error of a row of
BEFORE is read off the straight line between two of our settings, in logarithms. Leaves: out/bench/equal_error.json.

    python benchmarks/equal_error.py [--rounds 5]
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from peers_hagoromo import prepared, reference
from peers_numba import frames as numba_frames
from peers_scene import STUDIES, Scene, make_matter
from turns import medians, options, record

import hagoromo as hg
from hagoromo.image.modes import Shadows

BEFORE = (  # shadows, tolerance, time over that of the yardstick, relative error
    ("map", 0.16, 0.525, 0.02292),
    ("map", 0.08, 0.713, 0.01306),
    ("map", 0.04, 1.058, 0.00777),
    ("map", 0.02, 1.737, 0.00433),
    ("march", 0.16, 1.835, 0.01869),
    ("march", 0.04, 7.098, 0.00512),
    ("march", 0.02, 14.622, 0.00266),
)
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
        scene, small = (Scene(study[ball], Path(name)) for ball in ("ball, 1 lamp", "ball, 1 lamp, 64 px"))
        own = measured(scene, numba_frames(small)[YARDSTICK], rounds)
    rows = [against(own, *row) for row in BEFORE]
    for row in rows:
        print(row)
    record("equal_error", {"rounds": rounds, "own": own, "rows": rows})


def measured(scene: Scene, yardstick: Callable[[], Any], rounds: int) -> list[dict[str, Any]]:
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


def cpu_seconds(frame: Callable[[], Any]) -> float:
    """CPU time of all threads of the process in one frame [s]."""
    start = time.process_time()
    frame()
    return time.process_time() - start


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
