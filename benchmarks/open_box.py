"""Opening a box from disk: from its files to the first picture, against reading and decoding its chunks alone.

A fuzzy shell whose voxels are random (no codec shortens them much) is built to disk, in a process of its own. Another
one reads and decodes all files that `load_box` reads, with as many threads, and fills as much memory as the box takes:
no opening can do less. Then it loads the box and takes the first picture of a preview, in turn, A B A B …: medians and
their ratios to that least are printed, with files in the system's cache, and cold. A third one does the same without
the packed bricks: the arrays are cut into bricks.

    python benchmarks/open_box.py [--voxels 512 1024] [--share 0.045] [--rounds 5] [--out RECORD.json]
"""

from __future__ import annotations

import argparse
import datetime
import json
import multiprocessing
import os
import platform
import resource
import shutil
import statistics
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import drjit as dr
import numpy as np
import zarr
from numcodecs import Zstd

import hagoromo as hg
from hagoromo.backend import arrays
from hagoromo.backend import name as backend_name
from hagoromo.image.preview import Preview
from hagoromo.volume.box_header import BoxHeader
from hagoromo.volume.store.box_store import look_at_box
from hagoromo.volume.store.build_store import build_box
from hagoromo.volume.store.field_blocks import FieldBlocks
from hagoromo.volume.store.plan import BoxPlan
from hagoromo.volume.store.zarr_blocks import THREADS
from hagoromo_matter.noise import random

RADIUS = 0.4  # of the shell, in edges of the box, which is 1 m
AREA = 4.0 * 3.14159 * RADIUS**2
SPILL = 11.0  # voxels by which bricks that hold matter are thicker than it, for the shell at hand
PIXELS = 512
MATERIAL = hg.Reflectance(0.2, 0.3, 0.2, 1.5, hg.Spectrum.constant(0.8), name="grey")


def main() -> None:
    """Build, open, print, and write the record."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--voxels", type=int, nargs="+", default=[512, 1024], help="a side of the box")
    parser.add_argument("--share", type=float, default=0.045, help="of the bricks that hold matter")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--out", type=Path, help="JSON of all figures")
    asked = parser.parse_args()
    machine = f"{platform.machine()}, {os.cpu_count()} cores, {backend_name()}, Dr.Jit {dr.__version__}"
    print(f"{datetime.date.today()}, {machine}, Zarr {zarr.__version__}, Hagoromo {hg.__version__}")
    records = []
    for voxels in asked.voxels:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "shell.zarr"
            built = alone(build_shell, voxels, asked.share, path)
            packed = alone(open_shell, path, asked.rounds)
            shutil.rmtree(path / "packed")
            arrays_alone = alone(open_shell, path, asked.rounds)
        records.append({"voxels": voxels, **built, "packed": packed, "arrays": arrays_alone})
        print(described(records[-1]))
    if asked.out:
        record = {"machine": machine, "date": str(datetime.date.today()), "boxes": records}
        asked.out.write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8", newline="\n")


def alone(work: Callable[..., dict[str, Any]], *given: Any) -> dict[str, Any]:
    """What `work` returns, run in a fresh process."""
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        return pool.apply(work, given)


def build_shell(voxels: int, share: float, path: Path) -> dict[str, Any]:
    """Build the shell at `path`: seconds and resident memory."""
    edge = 1.0 / voxels
    half = max(0.5 * (share * voxels / AREA - SPILL), 1.0) * edge  # of its thickness

    def shell(point: Any) -> tuple[Any, Any]:
        out = point - 0.5
        number = arrays().Array3i(dr.floor(point * voxels))
        rough = arrays().Array3f(*(random((number.x, number.y, number.z), seed) for seed in (1, 2, 3)))
        density = dr.select(abs(dr.norm(out) - RADIUS) < half, random((number.x, number.y, number.z), 4), 0.0)
        return density, dr.normalize(dr.normalize(out) + 0.6 * (rough - 0.5))

    def occupied(middle: Any, radius: float) -> Any:
        return abs(dr.norm(middle - 0.5) - RADIUS) < half + radius

    plan = BoxPlan(BoxHeader(edge, 100.0, (MATERIAL,)), FieldBlocks(shell, (voxels, voxels, voxels), edge, occupied))
    start = time.perf_counter()
    build_box(plan, path, "shell")
    return {"build_s": time.perf_counter() - start, "build_mib": resident()}


def open_shell(path: Path, rounds: int) -> dict[str, Any]:
    """Seconds to look at a box, to read its files, to load it, and to its first picture: medians, and cold."""
    dr.eval(arrays().Float(1.0) + 1.0)  # the backend is up
    look = hg.Camera.preset("canon_eos_kiss_digital").look_at((0.5, -1.9, 0.5), (0.5, 0.5, 0.5))
    voxels = ("packed/density", "packed/axis") if (path / "packed").exists() else ("density", "axis")
    files = [file for name in (*voxels, "bricks") for file in (path / name / "c").rglob("*") if file.is_file()]
    seconds: dict[str, list[float]] = {"look_s": [], "read_s": [], "fill_s": [], "load_s": [], "picture_s": []}
    for turn in range(rounds + 1):
        start = time.perf_counter()
        size = look_at_box(path).bytes
        seconds["look_s"].append(time.perf_counter() - start)
        if turn == 0:
            forget(files)
        start = time.perf_counter()
        with ThreadPoolExecutor(THREADS) as threads:
            decoded = sum(threads.map(lambda file: len(Zstd().decode(file.read_bytes())), files))
        seconds["read_s"].append(time.perf_counter() - start)
        start = time.perf_counter()
        memory = np.empty(size, np.uint8)
        memory.fill(1)
        seconds["fill_s"].append(time.perf_counter() - start)
        del memory
        if turn == 0:
            forget(files)
        start = time.perf_counter()
        box = hg.load_box(path)
        dr.sync_thread()
        seconds["load_s"].append(time.perf_counter() - start)
        lamp = hg.Lamp(position=(3.0, -3.0, 3.0), intensity=10.0, spectrum=hg.Spectrum.constant(1.0))
        image = next(Preview().pictures(hg.Scene(look, (lamp,), (box,))))
        assert image.alpha.max() > 0.9
        seconds["picture_s"].append(time.perf_counter() - start)
        kept, size = box.bricks.kept, box.bricks.bytes
        del box  # memory is that of one box
    return {
        "bricks": kept, "box_mib": size / 2**20, "chunks_mib": decoded / 2**20,
        "files_mib": sum(file.stat().st_size for file in files) / 2**20, "open_mib": resident(),
        **{name: statistics.median(times[1:]) for name, times in seconds.items()},
        **{f"cold_{name}": times[0] for name, times in seconds.items()},
    }  # fmt: skip


def forget(files: list[Path]) -> None:
    """Drop files from the system's cache, where it lets us."""
    for path in files:
        with path.open("rb") as file:
            os.fsync(file.fileno())
            os.posix_fadvise(file.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)


def resident() -> float:
    """Largest resident memory of this process so far [MiB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def described(record: dict[str, Any]) -> str:
    """A record as lines of text."""
    bricks = record["packed"]["bricks"]
    share = bricks / (record["voxels"] / 8) ** 3
    return (
        f"{record['voxels']}³: {bricks} bricks ({share:.1%}), {record['packed']['box_mib']:.0f} MiB on the device\n"
        f"  built in {record['build_s']:.2f} s within {record['build_mib']:.0f} MiB resident\n"
        + "\n".join(f"  {name}: {opening(record[name])}" for name in ("packed", "arrays"))
    )


def opening(record: dict[str, Any]) -> str:
    """Figures of opening a box one way, as lines of text."""
    text = (
        f"{record['files_mib']:.0f} MiB of files, {record['chunks_mib']:.0f} MiB decoded, "
        f"within {record['open_mib']:.0f} MiB resident, looked at in {record['look_s']:.3f} s"
    )
    for title, cold in (("cached", ""), ("cold", "cold_")):
        read, fill, load, picture = (record[f"{cold}{name}_s"] for name in ("read", "fill", "load", "picture"))
        least = read + fill
        text += (
            f"\n    {title}: read and decode {read:.2f} s, fill memory {fill:.2f} s, load {load:.2f} s "
            f"(× {load / least:.2f}), first picture after {picture:.2f} s (× {picture / least:.2f})"
        )
    return text


if __name__ == "__main__":
    main()
