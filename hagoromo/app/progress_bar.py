"""Progress of a long command on standard error: a bar on a terminal, plain lines in a file or pipe."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from hagoromo.app.everywhere import quiet, verbose
from hagoromo.app.interrupt import heed
from hagoromo.errors import escaped
from hagoromo.progress import Progress

QUIET_S = 30.0  # a command shorter than this writes no lines, so that bad input is answered by one line alone
PAUSE_S = 10.0  # between two lines
LEAST_SHARE = 0.02  # of the work, from which the time of the rest is estimated
LONG_S = 60.0  # of one step, after which a line says where it is
LINE_SHARE = 0.1  # of the work, after which a line is due
LIVE = "HAGOROMO_LIVE"  # environment: a program reads the lines as they come, and wants each hundredth of the work
LIVE_PAUSE_S = 0.2


@contextmanager
def progress_bar(title: str, by_step: bool = False) -> Iterator[Progress]:
    """Progress of the command called `title`, shown on standard error. by_step: without a terminal, a line a
    step, as with --verbose.

    Each call raises `KeyboardInterrupt` if the command was interrupted and the interrupt was swallowed.
    """
    if quiet():
        yield _heeded
        return
    if not sys.stderr.isatty():
        live = bool(os.environ.get(LIVE))
        yield step_lines(title) if (by_step or verbose()) and not live else progress_lines(title, live=live)
        return
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
    from rich.progress import Progress as Bars

    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with Bars(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(title, total=1.0)

        def shown(share: float, step: str = "") -> None:
            heed()
            bar.update(task, completed=share, description=f"{title} {step}".strip())

        yield shown


def _heeded(share: float, step: str = "") -> None:
    """Progress that shows nothing."""
    heed()


def progress_lines(title: str, clock: Callable[[], float] = time.monotonic, live: bool = False) -> Progress:
    """Progress as plain lines on standard error: one per tenth of the work or new step, PAUSE_S apart or more.

    live: from the start, one per hundredth, LIVE_PAUSE_S apart or more.
    """
    quiet_s, pause_s, line_share = (0.0, LIVE_PAUSE_S, 0.01) if live else (QUIET_S, PAUSE_S, LINE_SHARE)
    start = clock()
    last_s, last_share, last_step = start + quiet_s - pause_s, -1.0, ""

    def shown(share: float, step: str = "") -> None:
        nonlocal last_s, last_share, last_step
        heed()
        if clock() - last_s < pause_s or (share - last_share < line_share and step == last_step):
            return
        last_s, last_share, last_step = clock(), share, step
        parts = [f"{100.0 * share:.0f} %", escaped(step), time_left(share, last_s - start)]
        print(f"{title}: {', '.join(part for part in parts if part)}", file=sys.stderr, flush=True)

    return shown


def step_lines(title: str, clock: Callable[[], float] = time.monotonic) -> Progress:
    """Progress as a plain line on standard error for each step that is done, with its time and that of all so far.

    A step is what stands before the first colon of what is said. A step that takes longer than LONG_S has a line of
    where it is by then, and again after each LONG_S.
    """
    start = last_s = last_line_s = clock()
    last_step = ""

    def shown(share: float, step: str = "") -> None:
        nonlocal last_s, last_line_s, last_step
        heed()
        whole, step = step, step.split(":")[0]
        now = clock()
        if step == last_step:
            if step and now - last_line_s >= LONG_S:
                last_line_s = now
                print(f"{title}: {100.0 * share:.0f} %, {escaped(whole)}", file=sys.stderr, flush=True)
            return
        last_line_s = now
        if last_step:
            spent = f"{now - last_s:.1f} s, {now - start:.0f} s in all"
            parts = [f"{escaped(last_step)} took {spent}", f"{100.0 * share:.0f} %", time_left(share, now - start)]
            print(f"{title}: {', '.join(part for part in parts if part)}", file=sys.stderr, flush=True)
        last_s, last_step = now, step

    return shown


def time_left(share: float, seconds: float) -> str:
    """Time that is left, in a few words, if a `share` of the work took `seconds`; or none."""
    if not LEAST_SHARE <= share < 1.0:
        return ""
    left = seconds * (1.0 - share) / share
    for unit, size in (("days", 86400.0), ("hours", 3600.0), ("min", 60.0)):
        if left >= 2.0 * size:
            return f"about {left / size:.0f} {unit} left"
    return f"about {left:.0f} s left"
