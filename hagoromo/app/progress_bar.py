"""Progress of a long verb on standard error: a bar on a terminal, nothing in a file or pipe."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager

from hagoromo.app.interrupt import heed
from hagoromo.progress import Progress


@contextmanager
def progress_bar(title: str) -> Iterator[Progress]:
    """A function to call with the share done (0–1) and, where it helps, the name of the step at hand.

    It raises `KeyboardInterrupt` when the verb was interrupted and nobody has heeded it.
    """
    if not sys.stderr.isatty():
        yield lambda share, step="": heed()
        return
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as Bars

    columns = (
        TextColumn("{task.description}"),
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
