"""Memory and rate of normals and shape from many large photographs: 96 near lamps of 12 Mpixel each, made on the fly.

    python benchmarks/near_tiles.py --scratch DIR [--tiles 24]

Every photograph is written into the tile store; the coarse solution is whole; of the tiles a sample is solved, which
the rate is measured on (all maps are as large as for all of them). The photographs repeat pixels: what is measured is
work and memory, not accuracy. Needs 14 GB of disk for the while.
"""

from __future__ import annotations

import json
import resource
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from hagoromo.camera.camera import Camera
from hagoromo.camera.sensor import Sensor
from hagoromo.measurement.surface.tile_store import tile_store
from hagoromo.measurement.surface.tiles import solve_coarse, solve_tiles
from hagoromo.photograph.photograph import Photograph
from studies.command import command
from studies.near_rig import SURFACE_DISTANCE, Finish, NearRig, TrueShape, exact, ring_rig, shaded, waves

WIDTH, HEIGHT, REPEAT = 4000, 3000, 8
WELL = 20_000.0  # electrons


@dataclass(frozen=True, eq=False)
class Repeated:
    """Photographs of a rig without cast shadows, every pixel `REPEAT` times in both directions."""

    rig: NearRig
    truth: TrueShape
    camera: Camera
    white: float

    @property
    def count(self) -> int:
        """How many photographs there are."""
        return len(self.rig.lamps)

    def photograph(self, number: int) -> Photograph:
        """The photograph of that number."""
        known = self.truth.labels >= 0
        small = np.zeros((*known.shape, 3), np.float32)
        small[known] = shaded(self.truth, self.rig.lamps[number], Finish(0.2)) / self.white
        values = small.repeat(REPEAT, axis=0).repeat(REPEAT, axis=1)
        variance = (np.maximum(values, 0.0) / WELL + (10.0 / WELL) ** 2).astype(np.float32)
        mask = (values[..., 0] < 1.0) & (values[..., 1] < 1.0) & (values[..., 2] < 1.0)
        return Photograph(values, variance, mask, self.camera, (self.rig.lamps[number],), f"{number}")


def photographs(lamps: int) -> Repeated:
    """The source: WIDTH × HEIGHT px under `lamps` lamps."""
    rig = ring_rig(WIDTH // REPEAT, HEIGHT // REPEAT, lamps)
    truth, small = exact(rig.camera, waves), rig.camera
    sensor = Sensor(WELL, WELL, 10.0, WELL / 4095.0, 0.0, 12)
    camera = replace(small.resampled(WIDTH, HEIGHT, (1.0 / REPEAT, 1.0 / REPEAT)), sensor=sensor)
    white = max(float(np.percentile(shaded(truth, lamp, Finish(0.2)), 99)) for lamp in rig.lamps) / 0.7
    return Repeated(rig, truth, camera, white)


def main(scratch: Path, tiles: int = 24, lamps: int = 96) -> None:
    """Measure and print a JSON record.

    Args:
        scratch: existing folder on a disk with 14 GB free.
        tiles: how many tiles to solve, spread over the picture.
        lamps: number of photographs.
    """
    source, record = photographs(lamps), dict[str, Any]()
    clock = _Clock(record)
    with tile_store(source, scratch, lambda share, step="": print(f"{step}", flush=True)) as store:
        clock.lap("store")
        coarse = solve_coarse(store, 1.02 * SURFACE_DISTANCE, progress=lambda share, step="": print(step, flush=True))
        clock.lap("coarse")
        chosen = range(0, store.count, max(store.count // tiles, 1))
        fine = solve_tiles(store, coarse, tiles=chosen)
        clock.lap("tiles")
        solved = int(np.isfinite(fine.variance).sum())
        record |= {
            "pixels_of_all": WIDTH * HEIGHT,
            "lamps": lamps,
            "tiles": f"{len(chosen)} of {store.count}",
            "pixel_lamps_per_core_second": solved * lamps / record["tiles_core_s"],
        }
    print(json.dumps(record, indent=1))


class _Clock:
    """Processor seconds between laps, and the peak of the memory so far."""

    def __init__(self, record: dict[str, Any]) -> None:
        self.record, self.last = record, time.process_time()

    def lap(self, name: str) -> None:
        """Enter the lap that ends."""
        now = time.process_time()
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
        self.record |= {f"{name}_core_s": now - self.last, f"{name}_peak_GiB": peak}
        print(name, self.record[f"{name}_core_s"], "s", peak, "GiB", flush=True)
        self.last = now


if __name__ == "__main__":
    command(main)
