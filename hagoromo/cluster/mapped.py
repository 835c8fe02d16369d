"""Mapped: a function of many tasks, here or on the workers of a scheduler; results have the order of the tasks."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from hagoromo.cluster.cluster import Here, Workers, workers_of
from hagoromo.progress import Progress, silent


@contextmanager
def here_or_on(scheduler: str | int | None) -> Iterator[Workers]:
    """The workers of `scheduler`, see `workers_of`; this process where it is None."""
    if scheduler is None:
        yield Here()
        return
    with workers_of(scheduler) as cluster:
        yield cluster


def mapped(
    work: Callable[..., Any],
    tasks: Sequence[tuple[Any, ...]],
    scheduler: str | int | None = None,
    progress: Progress = silent,
    names: Sequence[str] = (),
) -> list[Any]:
    """What `work` gives of each of `tasks`, its arguments, in their order; by default here, one after the other.

    A task that is random brings its own seeded generator: then its result is the same wherever and whenever it runs.
    names: of the tasks, for `progress`.
    """
    results: list[Any] = [None] * len(tasks)
    with here_or_on(scheduler) as workers:
        for done, (number, result) in enumerate(workers.results(work, tasks), 1):
            results[number] = result
            progress(done / len(tasks), names[number] if names else "")
    return results
