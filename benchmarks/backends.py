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
import re
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from backends_scenes import CASES
from scipy import stats

import hagoromo as hg

CHILD = Path(__file__).with_name("backends_child.py")
VOXELS = 512
BLOCK = 8  # px a side, of pictures with noise
SIGNIFICANCE = 1e-3  # chance that pictures with noise that agree are refused
LEAST_COVERED = 0.02  # alpha from which a pixel shows matter
Facts = dict[str, Any]


def main(arguments: Sequence[str] | None = None) -> int:
    """Render on every backend, compare with the first and print the table; gives the exit status."""
    asked = options().parse_args(arguments)
    with tempfile.TemporaryDirectory(prefix="hagoromo-backends-") as folder:
        kept = asked.keep or Path(folder)
        first = int(bool(asked.reference))
        runs = [run(name, kept / f"{k} {name}", k, asked) for k, name in enumerate(asked.backends, first)]
        if asked.reference:
            runs.insert(0, read(asked.reference))
        rows = [compared(one, other) for run_of in runs[1:] for one, other in pairs(runs[0], run_of)]
    for run_of in runs:
        print(said_of(run_of))
    for row in rows:
        print(line_of(row))
    write(asked.out, runs, rows)
    lost = [frame for run_of in runs for frame in run_of["frames"] if "why_not" in frame]
    wanted = len(asked.scenes) * len(asked.lines) * (len(runs) - 1)
    agree = sum(row["agrees"] for row in rows)
    print(f"{agree} of {wanted} pictures agree" if len(runs) > 1 else "nothing to compare with")
    return 0 if agree == wanted and not lost else 1


def options() -> argparse.ArgumentParser:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--backends", nargs="+", default=["llvm", "cuda"])
    parser.add_argument("--lines", nargs="+", type=int, default=[1080, 2160])
    parser.add_argument("--aspect", type=float, default=16 / 9, help="width of pictures over their height")
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
    return parser


def run(backend: str, folder: Path, seed: int, asked: argparse.Namespace) -> Facts:
    """All scenes on one backend: see `read`."""
    folder.mkdir(parents=True, exist_ok=True)
    environment = {**os.environ, "HAGOROMO_BACKEND": backend}

    def scene(name: str) -> None:
        path = folder / f"{stem(name)}.json"
        command = [sys.executable, CHILD, path.with_suffix(""), name, "--seed", seed, "--rounds", asked.rounds]
        command += ["--voxels", asked.voxels, "--aspect", asked.aspect, "--lines", *asked.lines]
        why_not = ended([str(part) for part in command], environment, asked.seconds)
        if why_not:
            frames = read_frames(path)
            lost = [{"scene": name, "lines": lines, "why_not": why_not} for lines in asked.lines[len(frames) :]]
            save(path, frames + lost)

    save(folder / "doctor.json", facts_of(environment, asked.seconds))
    with ThreadPoolExecutor(asked.jobs) as pool:
        list(pool.map(scene, asked.scenes))
    return read(folder)


def stem(name: str) -> str:
    """The name of a scene as that of files."""
    return "_".join(re.findall(r"\w+", name))


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
    frames = [frame for name in CASES for frame in read_frames(folder / f"{stem(name)}.json")]
    doctor = json.loads((folder / "doctor.json").read_text(encoding="utf-8"))
    return {"backend": folder.name.split()[-1], "folder": str(folder), "doctor": doctor, "frames": frames}


def save(path: Path, record: Any) -> None:
    """Write a record as JSON."""
    path.write_text(json.dumps(record), encoding="utf-8", newline="\n")


def read_frames(path: Path) -> list[Facts]:
    """The frames of one scene, none where there is no record."""
    return json.loads(path.read_text(encoding="utf-8")) if path.exists() else []


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
    finite = [{key: None if is_endless(value) else value for key, value in row.items()} for row in rows]
    hg.write_json(path, {"compared": finite, "runs": runs})


def is_endless(value: Any) -> bool:
    """Whether a value is a number that JSON has not."""
    return isinstance(value, float) and not np.isfinite(value)


if __name__ == "__main__":
    sys.exit(main())
