"""A dome's photographs at full size through `hagoromo capture`: memory, CPU seconds, bytes, and the automatic mask.

    python benchmarks/dome.py --photographs 48 --mpixel 24

Camera RAW (DNG of 14 bits, RGGB) of a ball on a cloth is simulated into a scratch folder beside the record, captured as
a user would, and deleted. Memory is the proportional set size of the command and its processes, read every 50 ms.
`--develop` also develops one photograph by `hagoromo develop`. The record is out/bench/dome.json.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.png import read_png
from hagoromo.files.record import write_json
from hagoromo.files.whole import whole_file
from studies.command import command
from studies.dome import dome_lamps
from tests.inverse.simulated_bracket import write_dng

BLACK, WHITE, GAIN, READ_NOISE = 512, 16_000, 2.1, 6.0  # DN, DN, e⁻/DN, e⁻
BALL = 0.62, 0.5, 0.3  # centre x, y and radius over the width, height and shorter side
SHARES = np.array([[0.55, 1.0], [1.0, 0.45]], np.float32)  # of the light at R, G, G, B
SECONDS = 0.125  # of an exposure
EVERY_S = 0.05
BYTES_OF_EACH = 5  # on disk per pixel and photograph: 2 of the RAW file, 3 of the capture at most


def main(
    photographs: int = 48, mpixel: float = 24.0, out: Path = Path("out/bench/dome.json"), develop: bool = False
) -> None:
    """Simulate the dome, capture it, and write the record.

    Args:
        photographs: how many, one lamp on in each.
        mpixel: millions of pixels of each.
        out: where the record goes; photographs and capture lie beside it while the command runs.
        develop: also develop one photograph by itself.
    """
    height = round(np.sqrt(mpixel * 1e6 / 1.5) / 2) * 2
    width = round(1.5 * height / 2) * 2
    out.parent.mkdir(parents=True, exist_ok=True)
    free = shutil.disk_usage(out.parent).free
    if free < 2.0 * BYTES_OF_EACH * photographs * width * height:
        raise InputError(f"{out.parent} has {free / 1e9:.1f} GB free: too few for {photographs} photographs")
    with tempfile.TemporaryDirectory(dir=out.parent) as scratch:
        home = Path(scratch)
        truth = simulate(home, photographs, width, height)
        raw = sorted(home.glob("*.dng"))
        stated = ("--gain", f"{GAIN}", "--read-noise", f"{READ_NOISE}")
        figures: dict[str, Any] = {"photographs": photographs, "width": width, "height": height}
        figures["capture"] = watched(
            "capture", *raw, "--lamps", home / "dome.lp", "--mask", "auto", "--out", home / "capture", *stated
        )
        written = sum(path.stat().st_size for path in (home / "capture" / "images").iterdir())
        figures["capture"]["bytes_of_each"] = written / photographs
        found = read_png(home / "capture" / "masks" / "object.png") > 0
        figures["mask"] = {"overlap": float((found & truth).sum() / (found | truth).sum())}
        if develop:
            figures["develop"] = watched("develop", raw[0], "--out", home / "one.exr", *stated)
            figures["develop"]["bytes_of_each"] = (home / "one.exr").stat().st_size
    with whole_file(out, force=True) as file:
        write_json(file, {"machine": {"cores": os.cpu_count(), "python": sys.version.split()[0]}, "figures": figures})
    print(json.dumps(figures, indent=1))


def simulate(home: Path, photographs: int, width: int, height: int) -> NDArray[np.bool_]:
    """Write the photographs and dome.lp; returns where the ball is."""
    random = np.random.default_rng(0)
    y, x = np.ogrid[:height, :width]
    radius = BALL[2] * min(width, height)
    across, down = ((x + 0.5 - BALL[0] * width) / radius).astype(np.float32), ((y + 0.5 - BALL[1] * height) / radius)
    down = down.astype(np.float32)
    towards = 1.0 - across**2 - down**2
    on = towards > 0.0
    towards = np.sqrt(np.maximum(towards, 0.0))
    albedo = np.tile(SHARES, (height // 2, width // 2))
    albedo *= np.where(on, 0.75 + 0.25 * np.sin(0.01 * x) * np.sin(0.013 * y), 0.05).astype(np.float32)
    noise = random.standard_normal((height, width), np.float32)
    directions = dome_lamps(photographs)
    for number, (right, up, ahead) in enumerate(directions.astype(np.float32)):
        light = np.where(on, np.maximum(across * right - down * up + towards * ahead, 0.0), ahead) * albedo
        signal = light * np.float32(0.9 * (WHITE - BLACK))
        drawn = np.roll(noise, tuple(random.integers(0, (height, width))), (0, 1))
        signal += drawn * np.sqrt(signal / np.float32(GAIN) + np.float32((READ_NOISE / GAIN) ** 2))
        raw = np.clip(np.rint(signal + BLACK), 0, WHITE).astype(np.uint16)
        write_dng(home / f"{number:02d}.dng", raw, SECONDS, BLACK, WHITE)
    rows = [f"{k:02d}.dng {x:.6f} {y:.6f} {z:.6f}" for k, (x, y, z) in enumerate(directions)]
    (home / "dome.lp").write_text("\n".join([str(photographs), *rows]) + "\n", encoding="utf-8")
    return on


def watched(*arguments: object) -> dict[str, float]:
    """Run a command of hagoromo: its peak of memory [MiB], CPU seconds and wall seconds."""
    start, before, peak = time.monotonic(), os.times(), 0.0
    child = subprocess.Popen([sys.executable, "-m", "hagoromo", *map(str, arguments)], stdout=subprocess.DEVNULL)
    while child.poll() is None:
        peak = max(peak, sum(map(own_memory, descendants(child.pid))))
        time.sleep(EVERY_S)
    if child.returncode:
        raise RuntimeError(f"hagoromo {arguments[0]} ended with {child.returncode}")
    after = os.times()
    cpu = after.children_user + after.children_system - before.children_user - before.children_system
    return {"peak_mib": peak, "cpu_s": cpu, "wall_s": time.monotonic() - start}


def descendants(pid: int) -> list[int]:
    """The process and all that it started, directly or not."""
    found = [pid]
    for one in found:
        for task in Path(f"/proc/{one}/task").glob("*/children"):
            try:
                found += [int(child) for child in task.read_text(encoding="ascii").split()]
            except OSError:
                continue
    return found


def own_memory(pid: int) -> float:
    """Proportional set size of a process [MiB]; 0 once it has ended."""
    try:
        lines = Path(f"/proc/{pid}/smaps_rollup").read_text(encoding="ascii").splitlines()
    except OSError:
        return 0.0
    return next((int(line.split()[1]) / 1024.0 for line in lines if line.startswith("Pss:")), 0.0)


if __name__ == "__main__":
    command(main)
