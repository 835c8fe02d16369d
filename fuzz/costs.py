"""Costs: what a try takes of time and memory, that of the processes apart included (Linux)."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import psutil

MOST_SECONDS = 20.0  # of computing
MOST_MEMORY = 1 << 30  # bytes, more than before
NEW_PROCESS = 300 << 20  # bytes that a process takes which starts meanwhile


@contextmanager
def costs() -> Iterator[Callable[[], str]]:
    """Gives, when the block has ended, what is wrong with its costs: "" where they are below the bounds."""
    said: list[str] = []
    own = psutil.Process()
    before = {each.pid: _used(each) for each in (own, *_children(own))}
    for number in before:
        _forget_peak(number)
    yield lambda: said[0]
    seconds, memory = 0.0, 0
    for each in (own, *_children(own)):
        computed, held = before.get(each.pid, (0.0, NEW_PROCESS))
        with suppress(psutil.Error):
            seconds += _used(each)[0] - computed
            memory = max(memory, _peak(each.pid) - held)
    slow = f"takes {seconds:.0f} s of computing" if seconds > MOST_SECONDS else ""
    said.append(slow or (f"takes {memory / 2**30:.1f} GiB of memory" if memory > MOST_MEMORY else ""))


def _children(process: psutil.Process) -> list[psutil.Process]:
    with suppress(psutil.Error):
        return process.children()
    return []


def _used(process: psutil.Process) -> tuple[float, int]:
    """Seconds that a process has computed, and bytes that it holds."""
    try:
        own = process.pid == psutil.Process().pid
        return time.process_time() if own else sum(process.cpu_times()[:2]), process.memory_info().rss
    except psutil.Error:
        return 0.0, 0


def _forget_peak(number: int) -> None:
    with suppress(OSError):
        Path(f"/proc/{number}/clear_refs").write_text("5")


def _peak(number: int) -> int:
    """The most bytes that a process has held since `_forget_peak`."""
    if sys.platform != "linux":
        return 0
    with suppress(OSError):
        for line in Path(f"/proc/{number}/status").read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) * 1024
    return 0
