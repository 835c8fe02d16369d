"""Two backends, one picture: the CPU's beside a GPU's, in all modes, and how long a picture takes on each.

Every scene of `backends_scenes.py` is rendered on every backend in a process of its own, with a time limit: what ends
one leaves the others, and all results are on disk as soon as they are known. A picture must agree with that of the
first backend: root mean square of the difference over root mean square where there is matter, within the bound of its
case; pictures with noise, of another seed each, by Z of blocks of pixels. Exit status 1: one does not agree or did not
come.

A backend may be absent: `--keep` leaves its pictures in a folder, from which `--reference` takes them elsewhere.

    python benchmarks/backends.py [--backends llvm cuda] [--lines 1080 2160] [--rounds 3] [--scenes shell "room, path"]

Leaves: out/bench/backends.json.
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
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from backends_scenes import CASES, Case, sized
from scipy import stats

import hagoromo as hg

VOXELS = 512
BLOCK = 8  # px a side, of pictures with noise
SIGNIFICANCE = 1e-3  # chance that pictures with noise that agree are refused
LEAST_COVERED = 0.02  # alpha from which a pixel shows matter
Facts = dict[str, Any]


def main(arguments: Sequence[str] | None = None) -> int:
    """Render on every backend, compare with the first and print the table; gives the exit status."""
    asked = options().parse_args(arguments)
    if asked.child:
        child(asked)
        return 0
    with tempfile.TemporaryDirectory(prefix="hagoromo-backends-") as folder:
        kept = asked.keep or Path(folder)
        runs = [
            run(name, kept / f"{k} {name}", k + bool(asked.reference), asked) for k, name in enumerate(asked.backends)
        ]
        if asked.reference:
            runs.insert(0, read(asked.reference))
        rows = [compared(one, other) for run_of in runs[1:] for one, other in pairs(runs[0], run_of)]
    for run_of in runs:
        print(said_of(run_of))
    for row in rows:
        print(line_of(row))
    write(asked.out, runs, rows)
    lone = [frame for frame in runs[0]["frames"] if "why_not" in frame] if len(runs) == 1 else []
    is_good = all(row.get("agrees") for row in rows) and not lone
    print("all agree" if is_good else "NOT all agree")
    return 0 if is_good else 1


def options() -> argparse.ArgumentParser:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--backends", nargs="+", default=["llvm", "cuda"])
    parser.add_argument("--lines", nargs="+", type=int, default=[1080, 2160])
    parser.add_argument("--scenes", nargs="+", choices=CASES, default=list(CASES), metavar="SCENE")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--voxels", type=int, default=VOXELS, help="voxels a side of the shell")
    parser.add_argument(
        "--seconds", type=float, default=1200.0, help="for a scene on a backend, after which it is ended"
    )
    parser.add_argument("--jobs", type=int, default=1, help="scenes at a time; times are then those of a busy machine")
    parser.add_argument("--keep", type=Path, help="folder for records and pictures of all backends")
    parser.add_argument("--reference", type=Path, help="folder of a backend within a kept one, to compare with")
    parser.add_argument("--out", type=Path, default=Path("out/bench/backends.json"))
    parser.add_argument("--child", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--seed", type=int, default=0, help=argparse.SUPPRESS)
    return parser


def run(backend: str, folder: Path, seed: int, asked: argparse.Namespace) -> Facts:
    """All scenes on one backend: see `read`."""
    folder.mkdir(parents=True, exist_ok=True)
    environment = {**os.environ, "HAGOROMO_BACKEND": backend}

    def scene(name: str) -> None:
        number = list(CASES).index(name)
        command = [sys.executable, __file__, "--child", folder / f"{number}", "--scenes", name, "--seed", seed]
        command += ["--rounds", asked.rounds, "--voxels", asked.voxels, "--lines", *asked.lines]
        why_not = ended([str(part) for part in command], environment, asked.seconds)
        if why_not:
            frames = read_frames(folder / f"{number}.json")
            lost = [{"scene": name, "lines": lines, "why_not": why_not} for lines in asked.lines[len(frames) :]]
            save(folder / f"{number}.json", frames + lost)

    save(folder / "doctor.json", facts_of(environment, asked.seconds))
    with ThreadPoolExecutor(asked.jobs) as pool:
        list(pool.map(scene, asked.scenes))
    return read(folder)


def ended(command: list[str], environment: dict[str, str], seconds: float) -> str:
    """Why a command did not end well; empty where it did."""
    try:
        done = subprocess.run(
            command, env=environment, capture_output=True, text=True, check=False, timeout=seconds, encoding="utf-8"
        )
    except subprocess.TimeoutExpired:
        return f"not done after {seconds:g} s"
    if not done.returncode:
        return ""
    return (done.stderr.strip().splitlines() or [f"ended with status {done.returncode}, without a word"])[-1]


def facts_of(environment: dict[str, str], seconds: float) -> Facts:
    """What `hagoromo doctor` says of a backend."""
    command = [sys.executable, "-m", "hagoromo", "doctor", "--json"]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False, timeout=seconds)
    if not done.stdout:
        return {"can_render": False, "why_not": (done.stderr.strip().splitlines() or ["doctor says nothing"])[-1]}
    return json.loads(done.stdout)


def read(folder: Path) -> Facts:
    """A backend of a kept folder: name, folder, what `doctor` says, and frames, each with times or `why_not`."""
    frames = [frame for number in range(len(CASES)) for frame in read_frames(folder / f"{number}.json")]
    doctor = json.loads((folder / "doctor.json").read_text(encoding="utf-8"))
    return {"backend": folder.name.split()[-1], "folder": str(folder), "doctor": doctor, "frames": frames}


def save(path: Path, record: Any) -> None:
    """Write a record as JSON."""
    path.write_text(json.dumps(record), encoding="utf-8", newline="\n")


def read_frames(path: Path) -> list[Facts]:
    """The frames of one scene, none where there is no record."""
    return json.loads(path.read_text(encoding="utf-8")) if path.exists() else []


def child(asked: argparse.Namespace) -> None:
    """Render one scene at every size on the backend of this process: a record, pictures, and PNGs to look at."""
    (name,) = asked.scenes
    case, frames = CASES[name], []
    start = time.perf_counter()
    scene = case.make(asked.voxels)
    built = time.perf_counter() - start
    for lines in asked.lines:
        taken, values = [], {}
        for _ in range(1 + asked.rounds):
            start = time.perf_counter()
            values = values_of(case, sized(scene, lines), asked.seed)
            taken.append(time.perf_counter() - start)  # the first with the compilation of kernels
        png = values.pop("png", None)
        if png is not None:
            hg.write_png(f"{asked.child}_{lines}.png", png)
        np.savez_compressed(f"{asked.child}_{lines}.npz", allow_pickle=False, **values)
        seconds = {"first_s": taken[0], "seconds": float(np.median(taken[1:] or taken)), "built_s": built}
        frames.append(
            {"scene": name, "lines": lines, "values": f"{asked.child.name}_{lines}.npz", **seconds, **memory()}
        )
        Path(f"{asked.child}.json").write_text(json.dumps(frames), encoding="utf-8", newline="\n")


def values_of(case: Case, scene: hg.Scene, seed: int) -> dict[str, np.ndarray]:
    """What is compared: colour and coverage, or Y and its variance where there is noise; or a gradient."""
    if case.mode == "gradient":
        shape = hg.render(scene, case.settings(), mode="full").weights.shape
        weights = np.random.default_rng(1).random(shape)
        return {"gradient": hg.full_gradient(scene, weights, case.settings()).values}
    image = hg.render(scene, case.settings(seed), mode=case.mode)
    values = {"png": image.display(), "alpha": image.alpha}
    if image.variance is not None:
        return values | {"y": image.xyz()[..., 1], "variance": image.variance}
    return values | {"colour": image.linear_srgb().astype(np.float32)}


def memory() -> Facts:
    """Memory of this process, and on the GPU where NVIDIA's driver says it [GiB]."""
    import psutil

    found: Facts = {"memory_gib": psutil.Process().memory_info().rss / 2**30}
    command = ["nvidia-smi", "--query-compute-apps=pid,used_memory", "--format=csv,noheader,nounits"]
    try:
        said = subprocess.run(command, capture_output=True, text=True, check=True, timeout=20).stdout
    except (OSError, subprocess.SubprocessError):
        return found
    held = [line.split(",") for line in said.splitlines()]
    own = [float(mib) / 2**10 for pid, mib in held if pid.strip() == str(os.getpid()) and mib.strip().isdigit()]
    return found | ({"gpu_gib": own[0]} if own else {})


def pairs(first: Facts, other: Facts) -> list[tuple[Facts, Facts]]:
    """Frames of the same scene and size, each with its backend and folder."""

    def keyed(run_of: Facts) -> dict[tuple[str, int], Facts]:
        more = {"backend": run_of["backend"], "folder": run_of["folder"]}
        return {(frame["scene"], frame["lines"]): frame | more for frame in run_of["frames"]}

    wanted = keyed(first)
    return [(wanted[key], frame) for key, frame in keyed(other).items() if key in wanted]


def compared(one: Facts, other: Facts) -> Facts:
    """How a frame differs from that of the first backend, and how long both take."""
    row = {key: other[key] for key in ("scene", "lines", "backend")}
    for frame in (one, other):
        if "why_not" in frame:
            return row | {"agrees": False, "why_not": f"{frame['backend']}: {frame['why_not']}"}
    keys = ("first_s", "seconds", "built_s", "gpu_gib")
    row |= {key: other[key] for key in keys if key in other}
    row |= {f"{key} of {one['backend']}": one[key] for key in keys[:3]}
    wanted, found = (dict(np.load(Path(frame["folder"]) / frame["values"])) for frame in (one, other))
    bound = CASES[row["scene"]].bound
    return row | (noisy_difference(wanted, found) if bound is None else difference(wanted, found, bound))


def difference(wanted: dict[str, np.ndarray], found: dict[str, np.ndarray], bound: float) -> Facts:
    """Of pictures without noise, or of a gradient: see the head of this file."""
    where = np.s_[:]
    if "alpha" in wanted:
        where = (wanted["alpha"] > 0) | (found["alpha"] > 0)  # where there is matter in either
        wanted, found = ({"picture": np.dstack([v["colour"], v["alpha"]])} for v in (wanted, found))
    (one,), (two,) = wanted.values(), found.values()
    gap, scale = (two - one)[where].astype(np.float64), one[where].astype(np.float64)
    off = float(np.sqrt(np.mean(gap**2) / np.mean(scale**2))) if np.isfinite(gap).all() else float("inf")
    return {"difference": off, "largest": float(np.abs(gap).max() / np.abs(scale).mean()), "agrees": off <= bound}


def noisy_difference(wanted: dict[str, np.ndarray], found: dict[str, np.ndarray]) -> Facts:
    """Of pictures with noise: Z of each block, all together by chi-square, and Z of the mean of all blocks."""
    gap, noise = blocks(found["y"] - wanted["y"]), blocks(found["variance"] + wanted["variance"])
    seen = (blocks(wanted["alpha"]) > LEAST_COVERED) & (noise > 0.0)
    z = gap[seen] / np.sqrt(noise[seen] / BLOCK**2)
    of_mean = float(gap[seen].sum() / np.sqrt(noise[seen].sum() / BLOCK**2))
    p = min(float(stats.chi2.sf((z**2).sum(), z.size)), 2.0 * float(stats.norm.sf(abs(of_mean))))
    mean = float(found["y"].mean() / wanted["y"].mean() - 1.0)
    figures = {"mean_off": mean, "z_of_mean": of_mean, "z_rms": float(np.sqrt(np.mean(z**2))), "p": p, "blocks": z.size}
    return {**figures, "agrees": p > SIGNIFICANCE}  # NaN does not


def blocks(values: np.ndarray) -> np.ndarray:
    """Means of blocks of pixels; what is left over is cut off."""
    rows, columns = (n // BLOCK for n in values.shape)
    cut = values[: rows * BLOCK, : columns * BLOCK].astype(np.float64)
    return cut.reshape(rows, BLOCK, columns, BLOCK).mean(axis=(1, 3))


def said_of(run_of: Facts) -> str:
    """One line on a backend: what it runs on, or why it does not."""
    facts = run_of["doctor"]
    if not facts["can_render"]:
        return f"{run_of['backend']}: {facts['why_not']}"
    return f"{run_of['backend']}: {json.dumps(facts['backends'][run_of['backend']])}, {facts['processor']['name']}"


def line_of(row: Facts) -> str:
    """One line on two frames."""
    head = f"{row['scene']:24s}{row['lines']:6d} lines  {row['backend']}: "
    if "why_not" in row:
        return f"{head}FAILS: {row['why_not']}"
    (key,) = (key for key in row if key.startswith("seconds of"))
    speed = f"first {row['first_s']:.3g} s, then {row['seconds']:.3g} s, {row[key] / row['seconds']:.3g} × as fast, "
    if "p" in row:
        gap = f"mean {row['mean_off']:+.2%}, Z {row['z_rms']:.3f} of {row['blocks']} blocks, p {row['p']:.2g}"
    else:
        gap = f"differs by {row['difference']:.2g}, at most {row['largest']:.2g} of the mean"
    return f"{head}{speed}{gap}{'' if row['agrees'] else '  DOES NOT AGREE'}"


def write(path: Path, runs: list[Facts], rows: list[Facts]) -> None:
    """Write what was found, without the pictures."""
    path.parent.mkdir(parents=True, exist_ok=True)
    hg.write_json(path, {"compared": rows, "runs": runs})


if __name__ == "__main__":
    sys.exit(main())
