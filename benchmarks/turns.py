"""Turns: contenders timed one after the other, A B C A B C …, and what was found recorded with machine and versions."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Hashable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import drjit as dr
import numpy as np
from peers_table import machine

from hagoromo.backend import name as backend_name
from hagoromo.files.record import write_json
from hagoromo.files.whole import whole_file

RECORDS = Path("out/bench")
Frame = Callable[[], Any]
Name = TypeVar("Name", bound=Hashable)


def seconds(frame: Frame) -> float:
    """Wall time of one frame, the device done with it [s]."""
    start = time.perf_counter()
    dr.eval(frame())
    dr.sync_thread()
    return time.perf_counter() - start


def in_turn(frames: Mapping[Name, Frame], rounds: int, most: float = 60.0) -> dict[Name, list[float]]:
    """Times [s] of every contender, after one frame each that is not counted; no new round after `most` seconds."""
    for frame in frames.values():
        seconds(frame)
    times: dict[Name, list[float]] = {name: [] for name in frames}
    begin = time.perf_counter()
    for _ in range(rounds):
        for name, frame in frames.items():
            times[name].append(seconds(frame))
        if time.perf_counter() - begin > most:
            break
    return times


def medians(times: Mapping[Name, list[float]]) -> dict[Name, float]:
    """Median time of every contender [s]."""
    return {name: float(np.median(taken)) for name, taken in times.items()}


def record(study: str, figures: Any) -> None:
    """Write the figures of a study where the page finds them, and say so."""
    path = RECORDS / f"{study}.json"
    with whole_file(path, force=True) as file:
        write_json(file, {"machine": machine() | {"backend": backend_name()}, "figures": figures})
    print(f"{path} written", flush=True)


def options(about: str | None, rounds: int) -> argparse.ArgumentParser:
    """The command line that all studies share."""
    parser = argparse.ArgumentParser(description=about, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=rounds)
    return parser
