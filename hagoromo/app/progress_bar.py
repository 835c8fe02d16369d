"""Progress of a long command on standard error: a bar on a terminal, plain lines in a file or pipe."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from hagoromo.app.interrupt import heed
from hagoromo.files.names import escaped
from hagoromo.progress import Progress

QUIET_S = 30.0  # a command shorter than this writes no lines, so that bad input is answered by one line alone
PAUSE_S = 10.0  # between two lines
LINE_SHARE = 0.1  # of the work, after which a line is due


@contextmanager
def progress_bar(title: str) -> Iterator[Progress]:
    """Progress of the command called `title`, shown on standard error.

    Each call raises `KeyboardInterrupt` if the command was interrupted and the interrupt was swallowed.
    """
    if not sys.stderr.isatty():
        yield progress_lines(title)
        return
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as Bars

    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeElapsedColumn(),
    )
    with Bars(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(title, total=1.0)

        def shown(share: float, step: str = "") -> None:
            heed()
            bar.update(task, completed=share, description=f"{title} {step}".strip())

        yield shown


def progress_lines(title: str, clock: Callable[[], float] = time.monotonic) -> Progress:
    """Progress as plain lines on standard error: one per tenth of the work or new step, PAUSE_S apart or more."""
    start = clock()
    last_s, last_share, last_step = start + QUIET_S - PAUSE_S, -1.0, ""

    def shown(share: float, step: str = "") -> None:
        nonlocal last_s, last_share, last_step
        heed()
        if clock() - last_s < PAUSE_S or (share - last_share < LINE_SHARE and step == last_step):
            return
        last_s, last_share, last_step = clock(), share, step
        print(f"{title}: {100.0 * share:.0f} %{', ' if step else ''}{escaped(step)}", file=sys.stderr, flush=True)

    return shown
