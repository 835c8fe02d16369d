"""Two backends, one picture: the CPU's beside a GPU's, and how long a frame takes on each at 1080 and 2160 lines.

Every backend renders in a process of its own, from the same recipe and the same shell of matter: `shell` with shadow
maps and with marched shadows, `shell and ball` with a surface that is traced as a mesh, and `skin`, whose box the
backend itself fills. A picture of a backend must be within 1e-3 of that of the first, root mean square over root mean
square; otherwise, or where a backend does not work, the exit status is 1. Written to out/bench/backends.json.

This has never been run on a GPU. With the CPU against itself it is part of the tests.

    python benchmarks/backends.py [--backends llvm cuda] [--lines 1080 2160] [--rounds 3] [--scenes shell skin]
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import hagoromo as hg

BOUND = 1e-3  # of the difference of two backends
ASPECT = 16 / 9
VOXELS, SKIN_MM = 512, 10.0
SCENES = ("shell", "shell, marched shadows", "shell and ball", "skin")


def main(arguments: Sequence[str] | None = None) -> int:
    """Render on every backend, compare with the first and print the table; gives the exit status."""
    asked = options().parse_args(arguments)
    if asked.child:
        child(Path(asked.child), asked)
        return 0
    with tempfile.TemporaryDirectory(prefix="hagoromo-backends-") as folder:
        runs = [run(backend, Path(folder) / str(k), asked) for k, backend in enumerate(asked.backends)]
        rows = [row for run in runs[1:] for row in compared(runs[0], run)]
    for run_of in runs:
        print(said_of(run_of))
    for row in rows:
        print(
            f"{row['scene']:24s}{row['lines']:6d} lines  {row['backend']}: {row['seconds']:.3g} s a frame, "
            f"{row['first_seconds'] / row['seconds']:.3g} × as fast, differs by {row['difference']:.2g}, "
            f"at most {row['largest']:.2g} of the mean"
        )
    write(asked.out, runs, rows)
    is_good = all("why_not" not in run for run in runs) and all(row["difference"] <= BOUND for row in rows)
    print("within" if is_good else "NOT within", f"{BOUND:g} of {asked.backends[0]}")
    return 0 if is_good else 1


def options() -> argparse.ArgumentParser:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--backends", nargs="+", default=["llvm", "cuda"])
    parser.add_argument("--lines", nargs="+", type=int, default=[1080, 2160])
    parser.add_argument("--scenes", nargs="+", choices=SCENES, default=list(SCENES))
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--voxels", type=int, default=VOXELS, help="voxels a side of the shell")
    parser.add_argument("--skin-mm", type=float, default=SKIN_MM, help="size of the patch of skin")
    parser.add_argument("--out", type=Path, default=Path("out/bench/backends.json"))
    parser.add_argument("--child", help=argparse.SUPPRESS)
    return parser


def run(backend: str, folder: Path, asked: argparse.Namespace) -> dict[str, Any]:
    """Times and pictures of one backend: `seconds` and `pictures` by scene and lines, or `why_not`."""
    folder.mkdir()
    command = [sys.executable, __file__, "--child", folder, "--rounds", asked.rounds, "--voxels", asked.voxels]
    command += ["--skin-mm", asked.skin_mm, "--lines", *asked.lines, "--scenes", *asked.scenes]
    environment = {**os.environ, "HAGOROMO_BACKEND": backend}
    done = subprocess.run([str(part) for part in command], env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        return {"backend": backend, "why_not": (done.stderr.strip().splitlines() or ["no word why"])[-1]}
    record = json.loads((folder / "record.json").read_text(encoding="utf-8"))
    pictures = {row["picture"]: np.load(folder / row["picture"]) for row in record["frames"]}
    return {"backend": backend, **record, "pictures": pictures}


def child(folder: Path, asked: argparse.Namespace) -> None:
    """Render every scene at every size on the backend of this process, and write pictures and times to `folder`."""
    frames = []
    for number, name in enumerate(asked.scenes):
        start = time.perf_counter()
        scene, settings = scene_of(name, asked)
        built = time.perf_counter() - start
        for lines in asked.lines:
            sized = scene.with_camera(camera_of(scene, lines))
            start = time.perf_counter()
            image = hg.render(sized, settings)
            taken = [time.perf_counter() - start]  # with the compilation of kernels
            for _ in range(asked.rounds):
                start = time.perf_counter()
                hg.render(sized, settings)
                taken.append(time.perf_counter() - start)
            picture = f"{number}_{lines}.npy"
            np.save(folder / picture, np.dstack([image.linear_srgb(), image.alpha]).astype(np.float32))
            seconds = {"first_s": taken[0], "seconds": float(np.median(taken[1:] or taken)), "built_s": built}
            frames.append({"scene": name, "lines": lines, "picture": picture, **seconds})
    text = json.dumps({"frames": frames, "doctor": hg.doctor()})
    (folder / "record.json").write_text(text, encoding="utf-8", newline="\n")


def scene_of(name: str, asked: argparse.Namespace) -> tuple[hg.Scene, hg.Settings]:
    """A scene whose camera is set by its size later, and how it is rendered."""
    from shells import FUZZY, MIDDLE, camera, lamps

    if name == "skin":
        recipe = Path(__file__).parents[1] / "examples" / "recipes" / "skin.toml"
        box = hg.build({**hg.read_toml(recipe), "size_mm": asked.skin_mm})
        low, high = box.corners().min(axis=0), box.corners().max(axis=0)
        middle, size = (low + high) / 2, float((high - low).max())
        eye = middle + np.array([0.0, -0.6, 2.0]) * size
        seen = hg.Camera(64, 64, (120.0, 120.0), (32.0, 32.0)).look_at(eye, middle)
        places = middle + size * np.array([(2.0, -1.0, 3.0), (-3.0, 1.0, 2.0)])
        lit = tuple(hg.Lamp(position=place, intensity=size**2) for place in places)
        return hg.Scene(seen, lit, (box,)), hg.Settings()
    surfaces = ()
    if name == "shell and ball":
        matte = hg.Reflectance(0.25, 0.1, 0.2, 1.5, hg.Spectrum.constant(0.8))
        surfaces = (
            hg.Surface.sphere(tuple(MIDDLE + np.array([0.15, -0.5, 0.1])), 0.15, matte),
            hg.Surface.floor(-0.1, 3.0, matte),
        )
    shadows = "march" if name == "shell, marched shadows" else "map"
    scene = hg.Scene(camera(64), lamps(3), (FUZZY.box(asked.voxels),), surfaces)
    return scene, hg.Settings(shadows=shadows)


def camera_of(scene: hg.Scene, lines: int) -> hg.Camera:
    """The camera of a scene with another number of lines, in the format of film, with the same height of view."""
    first = scene.camera
    focal, width = first.focal[1] * lines / first.height, round(lines * ASPECT)
    pose = first.world_to_camera
    return hg.Camera(width, lines, (focal, focal), (width / 2, lines / 2), world_to_camera=pose)


def compared(first: dict[str, Any], other: dict[str, Any]) -> list[dict[str, Any]]:
    """How the frames of a backend differ from those of the first, and how long they take."""
    rows = []
    if "why_not" in first or "why_not" in other:
        return rows
    for one, two in zip(first["frames"], other["frames"], strict=True):
        wanted, found = first["pictures"][one["picture"]], other["pictures"][two["picture"]]
        where = (wanted[..., 3] > 0) | (found[..., 3] > 0)  # where there is matter in either
        gap, scale = (found - wanted)[where].astype(np.float64), wanted[where].astype(np.float64)
        difference = np.sqrt(np.mean(gap**2) / np.mean(scale**2)) if np.isfinite(gap).all() else np.inf
        rows.append({
            "scene": one["scene"], "lines": one["lines"], "backend": other["backend"], "seconds": two["seconds"],
            "first_seconds": one["seconds"], "difference": float(difference),
            "largest": float(np.abs(gap).max() / scale.mean()),
        })  # fmt: skip
    return rows


def said_of(run: dict[str, Any]) -> str:
    """One line on a backend: what it runs on, or why it does not."""
    if "why_not" in run:
        return f"{run['backend']}: {run['why_not']}"
    facts = run["doctor"]
    return f"{run['backend']}: {json.dumps(facts['backends'][run['backend']])}, {facts['processor']['name']}"


def write(path: Path, runs: list[dict[str, Any]], rows: list[dict[str, Any]]) -> None:
    """Write what was found, without the pictures."""
    path.parent.mkdir(parents=True, exist_ok=True)
    shown = [{name: value for name, value in run.items() if name != "pictures"} for run in runs]
    hg.write_json(path, {"bound": BOUND, "compared": rows, "runs": shown})


if __name__ == "__main__":
    sys.exit(main())
