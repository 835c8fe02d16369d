"""Run: workers over all readers, with a watchdog for those that crash or hang, and a report."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

import psutil

from fuzz.judge import FAULT, READ, REFUSED
from fuzz.readers import READERS
from fuzz.worker import GOOD, SWAPS, FuzzJob

MOST_SWAPS = 1 << 20  # of a reader: all
COUNT = 60  # mutations of a reader at a time
HANG_S = 120.0  # of computing: a single file that takes longer is called a hang
WAIT_S = 20 * HANG_S  # that a file may take by the clock, on a machine that has much else to do
ROOT = Path(__file__).resolve().parents[1]
Try = dict[str, Any]  # reader, seed, outcome, kind, text


class FuzzOutcome(NamedTuple):
    """tallies: reader → how many mutations were read, refused, faults. faults: all that went wrong."""

    tallies: dict[str, Counter[str]]
    faults: list[Try]


def fuzzed(
    names: Sequence[str] = (), first: int = 0, count: int = COUNT, minutes: float = 0.0, processes: int = 1
) -> FuzzOutcome:
    """Mutations `first` to first + count of the readers; with `minutes`, further ones until the time is over."""
    outcome = FuzzOutcome(defaultdict(Counter), [])
    end = time.monotonic() + 60.0 * minutes
    while True:
        _try([FuzzJob(name, first, max(round(count * READERS[name].share), 1)) for name in names or READERS], processes,
             outcome)  # fmt: skip
        first += count
        if time.monotonic() >= end:
            return outcome


def swapped(names: Sequence[str] = (), processes: int = 1) -> FuzzOutcome:
    """Each node of each JSON and TOML file that the readers take, replaced by a value of each type, one at a time."""
    outcome = FuzzOutcome(defaultdict(Counter), [])
    _try([FuzzJob(name, SWAPS, MOST_SWAPS) for name in names or READERS], processes, outcome)
    return outcome


def _try(jobs: Sequence[FuzzJob], processes: int, outcome: FuzzOutcome) -> None:
    with ThreadPoolExecutor(processes) as threads:
        for tries in threads.map(_tried, [jobs[k::processes] for k in range(processes)]):
            _add(tries, outcome)


def _add(tries: Sequence[Try], outcome: FuzzOutcome) -> None:
    for one in tries:
        outcome.tallies[one["reader"]][one["outcome"]] += 1
        if one["outcome"] == FAULT:
            outcome.faults.append(one)


def _tried(jobs: Sequence[FuzzJob]) -> list[Try]:
    """The jobs in one process; after a crash or a hang another process goes on behind it."""
    tries: list[Try] = []
    left = list(jobs)
    while left:
        with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
            results = Path(folder) / "results"
            results.touch()
            end = _watched([sys.executable, "-m", "fuzz.worker", str(results), *map(str, left)], results)
            tries += [json.loads(line) for line in results.read_text(encoding="utf-8").splitlines()]
            if not end:
                return tries
            now = results.with_suffix(".now")
            name, seed = json.loads(now.read_text()) if now.exists() else (left[0].reader, left[0].first)
        tries.append({"reader": name, "seed": seed, "outcome": FAULT, "kind": end.split("\n")[0], "text": end})
        at = next(k for k, job in enumerate(left) if job.reader == name)
        last = left[at].first + left[at].count
        more = GOOD < seed < last - 1
        left = [*([FuzzJob(name, seed + 1, last - seed - 1)] if more else []), *left[at + 1 :]]
    return tries


def _watched(command: list[str], results: Path) -> str:
    """ "" when the process ended well, else what happened to it."""
    now = results.with_suffix(".now")
    with tempfile.TemporaryFile() as said:
        process = subprocess.Popen(command, stdout=said, stderr=said, cwd=ROOT)
        watched = psutil.Process(process.pid)
        seen, since, used = "", time.monotonic(), 0.0
        while True:
            try:
                process.wait(1.0)
                break
            except subprocess.TimeoutExpired:
                at = now.read_text() if now.exists() else ""
                computed = sum(watched.cpu_times()[:2])
                if at != seen:
                    seen, since, used = at, time.monotonic(), computed
                elif computed - used > HANG_S or time.monotonic() - since > WAIT_S:
                    process.kill()
                    process.wait()
                    return f"hang of {HANG_S:.0f} s"
        said.seek(0)
        text = said.read().decode("utf-8", "replace")[-2000:]
    return "" if process.returncode == 0 else f"process ended with {process.returncode}\n{text}"


def report(outcome: FuzzOutcome) -> str:
    """A table of the readers, and the faults by kind with a seed of each."""
    titles = ("tried", READ, REFUSED, "unclean")
    rows = ["".join([f"{'reader':28}", *(f"{title:>9}" for title in titles)])]
    total: Counter[str] = sum(outcome.tallies.values(), Counter())
    for name, tally in [*outcome.tallies.items(), ("all", total)]:
        figures = (sum(tally.values()), tally[READ], tally[REFUSED], tally[FAULT])
        rows.append("".join([f"{name:28}", *(f"{figure:9}" for figure in figures)]))
    kinds: dict[tuple[str, str], list[int]] = defaultdict(list)
    for fault in outcome.faults:
        kinds[fault["reader"], fault["kind"]].append(fault["seed"])
    for (name, kind), seeds in sorted(kinds.items(), key=lambda entry: -len(entry[1])):
        rows.append(f"{len(seeds):5} × {kind}    python -m fuzz --reader {name} --seed {seeds[0]}")
    return "\n".join(rows)
