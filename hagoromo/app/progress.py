"""Progress of a long verb on standard error: a bar on a terminal, nothing in a file or pipe."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol

from hagoromo.app.interrupt import heed


class Progress(Protocol):
    """Told the share done (0–1) and, where it helps, the name of the step at hand."""

    def __call__(self, share: float, step: str = "") -> None:
        """Show it."""


@contextmanager
def progress_bar(title: str) -> Iterator[Progress]:
    """A function to call with the share done (0–1) and, where it helps, the name of the step at hand.

    It raises `KeyboardInterrupt` when the verb was interrupted and nobody has heeded it.
    """
    if not sys.stderr.isatty():
        yield lambda share, step="": heed()
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(title, total=1.0)

        def shown(share: float, step: str = "") -> None:
            heed()
            bar.update(task, completed=share, description=f"{title} {step}".strip())

        yield shown
