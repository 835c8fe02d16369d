"""Matter in memory: largest resident memory and CPU time to build and export boxes, each in a process of its own.

A swatch of 30 mm of a draft of 12 threads, whose repeat is 10 mm of texel; hair, skin and wings as they are shipped;
the hair as OpenVDB, NRRD and VTI; what `info` says of it, and a first picture. BEFORE has what the same took before
levels of texels, sums of fibres and exports were made part by part. Written to out/bench/matter_memory.json.

    python benchmarks/matter_memory.py
"""

from __future__ import annotations

import multiprocessing
import resource
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import hagoromo as hg  # each process imports what it needs, and no other contenders

MATERIAL = {"alpha": 0.26, "beta": 0.2, "gamma": 0.35, "n": 1.54, "body_colour": 0.8}
SWATCH = {"kind": "cloth", "seed": 1, "threads_per_cm": 12, "draft": {"file": "twelve.wif"}, "material": MATERIAL}
THREADING, TREADLING = (1, 2, 3, 4, 1, 2, 4, 3, 2, 1, 4, 3), (1, 2, 3, 4, 1, 2, 3, 4, 3, 2, 1, 4)
EXPORTS = "vdb", "nrrd", "vti"
SOLVED = "swatch", "wing"  # pictures of all orders of light, without walks
# largest resident memory [MiB] and CPU time [s] at commit d3debf53, on two cores of an Intel Xeon
BEFORE = {
    "swatch": (6587, 76.9), "hair": (1728, 40.4), "skin": (528, 9.1), "wing": (542, 5.9),
    "hair.vdb": (6367, 85.1), "hair.nrrd": (1944, 14.2),
}  # fmt: skip


def main() -> None:
    """A row for each build, export and look."""
    from turns import options, record

    options(__doc__, 1).parse_args()
    rows: list[dict[str, Any]] = []
    with TemporaryDirectory() as folder:
        home = Path(folder)
        (home / "twelve.wif").write_text(wif(), encoding="utf-8")
        for name in ("swatch", "hair", "skin", "wing"):
            rows.append(alone(measured, name, built, home, name))
        for suffix in EXPORTS:
            rows.append(alone(measured, f"hair.{suffix}", exported, home, suffix))
        rows.append(alone(measured, "info of hair", contents, home))
        rows.append(alone(measured, "first picture of hair", pictured, home))
        for name in SOLVED:
            rows.append(alone(measured, f"mode full of {name}", solved, home, name))
    for row in rows:
        peak, cpu = BEFORE.get(row["what"], ("", ""))
        row |= {"before_mib": peak, "before_cpu_s": cpu}
        print(row, flush=True)
    record("matter_memory", rows)


def alone(work: Callable[..., dict[str, Any]], *given: Any) -> dict[str, Any]:
    """What `work` returns, run in a fresh process."""
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        return pool.apply(work, given)


def measured(what: str, work: Callable[..., Path], home: Path, *given: Any) -> dict[str, Any]:
    """Peak of resident memory, Python and the compiler included, CPU time, and size of the result on disk."""
    from peers_child import peak_memory

    made = work(home, *given)
    used = resource.getrusage(resource.RUSAGE_SELF)
    files = [made] if made.is_file() else [file for file in made.rglob("*") if file.is_file()]
    return {
        "what": what, "mib": int(peak_memory()), "cpu_s": used.ru_utime + used.ru_stime,
        "disk_mib": int(sum(file.stat().st_size for file in files) / 2**20),
    }  # fmt: skip


def built(home: Path, name: str) -> Path:
    """The box of the swatch, or of a shipped recipe."""
    from hagoromo.matter.build import build_to

    recipe: Any = name
    if name == "swatch":
        recipe = SWATCH | {"draft": {"file": str(home / "twelve.wif")}}
    build_to(recipe, home / f"{name}.zarr")
    return home / f"{name}.zarr"


def exported(home: Path, suffix: str) -> Path:
    """The hair as a volume of another program."""
    hg.convert(home / "hair.zarr", home / f"hair.{suffix}")
    return home / f"hair.{suffix}"


def contents(home: Path) -> Path:
    """What `info` says of the hair."""
    from hagoromo.app.info import info

    info(home / "hair.zarr")
    return home / "hair.zarr"


def pictured(home: Path) -> Path:
    """The first picture of the hair that a viewer shows."""
    box = hg.load_box(home / "hair.zarr")
    camera = hg.Camera(512, 512, (700.0, 700.0), (256.0, 256.0)).look_at((0.0, -0.7, 0.3), (0.0, 0.0, 0.2))
    next(hg.Preview().pictures(hg.Scene(camera, (hg.Lamp(to_lamp=(0.4, -1.0, 0.6)),), (box,))))
    return home / "hair.zarr"


def solved(home: Path, name: str) -> Path:
    """A small picture of mode full, which is mostly its solution; prints how many cells that has."""
    box = hg.load_box(home / f"{name}.zarr")
    low, high = box.matter_corners().min(axis=0), box.matter_corners().max(axis=0)
    middle, size = 0.5 * (low + high), max(high - low)
    camera = hg.Camera(64, 64, (96.0, 96.0), (32.0, 32.0)).look_at(middle + size * np.array([0.0, -1.5, 0.5]), middle)
    scene = hg.Scene(camera, (hg.Lamp(to_lamp=(0.4, -1.0, 0.6)),), (replace(box, extinction="projected"),))
    image = hg.render(scene, hg.Settings(walks=0), mode="full")
    print(name, image.metadata["field"], flush=True)
    image.save(home / f"{name}.exr")
    return home / f"{name}.exr"


def wif() -> str:
    """The draft: four shafts and treadles, 12 ends and 12 picks, none of which is the repeat of fewer."""
    tie_up = "\n".join(f"{k + 1}={k + 1},{(k + 1) % 4 + 1}" for k in range(4))
    threads = {"threading": THREADING, "treadling": TREADLING}
    lists = "\n".join(
        f"[{name.upper()}]\n" + "\n".join(f"{k}={number}" for k, number in enumerate(numbers, 1))
        for name, numbers in threads.items()
    )
    return (
        f"[WIF]\nVersion=1.1\n[WEAVING]\nShafts=4\nTreadles=4\n[WARP]\nThreads=12\n[WEFT]\nThreads=12\n"
        f"[TIEUP]\n{tie_up}\n{lists}\n"
    )


if __name__ == "__main__":
    main()
