"""What bounds the march: KERNEL's frame without shadows, its walk alone, and this machine.

The walk is the optical depth of the same rays, to where the march ends: it finds cells, reads densities and shades
nothing. The machine: rates of gathers from tables of many sizes, at random and in order, of a stream of memory, and of
multiply-adds, each by a kernel that does nothing else. Written to out/bench/bound.json.

    python benchmarks/bound.py [--rounds 9]
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import drjit as dr
import numpy as np
from march import PIXELS, ReferenceScene, camera_rays
from steps import counts_of_march, counts_of_walk
from turns import in_turn, medians, options, record

from hagoromo.backend import arrays
from hagoromo.transport.march import END_TRANSMITTANCE, optical_depth

TILE = 16  # neighbouring rays that step together
DEEPEST = -math.log(END_TRANSMITTANCE)  # optical depth at which the march ends
LANES = 1 << 18  # as many as the frame has rays
READS = 64  # of every lane, from a table
TABLES = tuple(1 << k for k in range(12, 29, 2))  # [byte]
STREAM = 1 << 25  # floats of an array
CHAINS, LINKS, TURNS = 8, 8, 64  # of multiply-adds: independent ones, in each, times


def main() -> None:
    """Time the frame, its walk and the machine's roofs in turn."""
    rounds = options(__doc__, 9).parse_args().rounds
    scene = ReferenceScene()
    lighting = scene.lighting()
    parts = {"whole": lambda: scene.frame(lighting), "walk": lambda: walk(scene)}
    found: dict[str, Any] = {"parts_s": medians(in_turn(parts, rounds)), "rays": PIXELS**2}
    found |= counted(scene)
    found["gather_rates"] = [{"bytes": size, "per_s": gather_rate(size, rounds)} for size in TABLES]
    found["stream_bytes_per_s"], found["flops_per_s"] = stream_rate(rounds), arithmetic_rate(rounds)
    for name, value in found.items():
        print(name, value)
    record("bound", found)


def walk(scene: ReferenceScene) -> Any:
    """Optical depth of the frame's rays."""
    jit = arrays()
    return optical_depth(scene.medium, *camera_rays(scene.tiles), jit.Float(0), jit.Float(dr.inf), DEEPEST)


def counted(scene: ReferenceScene) -> dict[str, Any]:
    """Turns and lit samples of the march, turns of the walk, and how many of TILE rays are on their way."""
    rays = camera_rays(scene.tiles)
    steps, samples = (np.array(each) for each in counts_of_march([scene.box], scene.lighting(), *rays))
    walked = np.array(counts_of_walk([scene.box], *rays, DEEPEST))
    return {
        "steps": {"whole": int(steps.sum()), "walk": int(walked.sum())},
        "samples": int(samples.sum()), "lanes": TILE, "busy": busy_lanes(steps),
    }  # fmt: skip


def busy_lanes(steps: np.ndarray) -> float:
    """Share of the steps of TILE neighbouring rays, marched together, that are not spent waiting for the longest."""
    tiles = steps.reshape(-1, TILE)
    return float(tiles.sum() / (TILE * tiles.max(axis=1)).sum())


def gather_rate(size: int, rounds: int) -> float:
    """Gathered words a second, from random places of a table of `size` [byte]."""
    jit = arrays()
    table = dr.arange(jit.UInt, size // 4)
    dr.make_opaque(table)
    mask = dr.opaque(jit.UInt, size // 4 - 1)
    return LANES * READS / typical(lambda: read_at_random(HeldTable(table), mask), rounds)


class HeldTable:
    """A table in a plain object, so that loops do not take it into their state."""

    def __init__(self, values: Any) -> None:
        self.values = values


@dr.syntax
def read_at_random(table: HeldTable, mask: Any) -> Any:
    """READS gathers of every lane; no place depends on what was read."""
    UInt = arrays().UInt
    turn, total = dr.zeros(UInt, LANES), dr.zeros(UInt, LANES)
    place = dr.arange(UInt, LANES) * 0x9E3779B9
    while turn < READS // 8:
        for _ in range(8):
            place = place * 1664525 + 1013904223
            total ^= dr.gather(UInt, table.values, (place >> 7) & mask)
        turn += 1
    return total


def stream_rate(rounds: int) -> float:
    """Bytes a second read and written by a + s b."""
    jit = arrays()
    a, b, s = dr.arange(jit.Float, STREAM), dr.arange(jit.Float, STREAM) + 1.0, dr.opaque(jit.Float, 3.0)
    dr.eval(a, b)
    return 3 * 4 * STREAM / typical(lambda: dr.fma(s, b, a), rounds)


def arithmetic_rate(rounds: int) -> float:
    """Operations a second of multiply-adds, two each."""
    return 2 * LANES * CHAINS * LINKS * TURNS / typical(multiply_adds, rounds)


@dr.syntax
def multiply_adds() -> Any:
    """CHAINS chains of multiply-adds."""
    jit = arrays()
    turn, factor = dr.zeros(jit.UInt, LANES), dr.opaque(jit.Float, 0.999)
    chains = [jit.Float(dr.arange(jit.UInt, LANES) + k) for k in range(CHAINS)]
    while turn < TURNS:
        chains = linked(chains, factor)
        turn += 1
    return sum(chains)


def linked(chains: list[Any], factor: Any) -> list[Any]:
    """Every chain LINKS multiply-adds longer."""
    for _ in range(LINKS):
        chains = [dr.fma(chain, factor, factor) for chain in chains]
    return chains


def typical(kernel: Callable[[], Any], rounds: int) -> float:
    """Median time of a kernel [s]."""
    return medians(in_turn({"": kernel}, rounds))[""]


if __name__ == "__main__":
    main()
