"""Cluster: Dask's workers, on this machine or on many, that run pure functions on small arguments.

`distributed` schedules, moves results, and runs again what a worker held that died. A function that is sent must give
the same bits wherever it runs and whenever: then nothing is lost with a worker. Every worker is one process with one
task at a time; Dr.Jit's threads use the cores inside it.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Protocol

from hagoromo.backend import set_threads
from hagoromo.cluster.connection import FORMS, THREADS, check_version, connected, cores, shown, started
from hagoromo.errors import InputError
from hagoromo.files.stores import keep_fetched
from hagoromo.progress import Progress, silent
from hagoromo.version import __version__

MOST_WORKERS = 256  # processes on this machine
AHEAD = 4  # tasks a worker that wait on the scheduler; more only when these are done
LARGE_GRAPH = "distributed.admin.large-graph-warning-threshold"  # Dask's own, of 10 MB
LARGEST_ARGUMENT = "64GB"  # a field of matter is one argument
NO_DASK = "--scheduler needs Dask, which is not installed: install hagoromo[cluster]"


Tasks = Iterable[tuple[Any, ...] | None]  # the arguments of each, or None: the next is not known until one is done


class Workers(Protocol):
    """Who runs tasks: this process, or the workers of a cluster."""

    def results(self, work: Callable[..., Any], tasks: Tasks, keep_errors: bool = False) -> Iterator[tuple[int, Any]]:
        """Number and result of every task as it is done, in any order; see `Cluster`."""
        ...


class Here:
    """This process, which runs one task after the other."""

    def results(self, work: Callable[..., Any], tasks: Tasks, keep_errors: bool = False) -> Iterator[tuple[int, Any]]:
        """Number and result of every task; a None ends them, because nothing is under way."""
        for number, arguments in enumerate(tasks):
            if arguments is None:
                return
            try:
                yield number, work(*arguments)
            except InputError as error:
                if not keep_errors:
                    raise
                yield number, error


class Cluster:
    """Workers that a Dask client reaches."""

    def __init__(self, client: Any) -> None:
        self.client = client

    @property
    def workers(self) -> int:
        """How many workers there are now."""
        return len(self.client.scheduler_info(n_workers=-1)["workers"])

    def run(self, work: Callable[..., Any], *arguments: Any) -> Any:
        """What `work` gives of `arguments`, on any worker."""
        return next(iter(self.results(work, [arguments])))[1]

    def hold(self, argument: Any) -> Any:
        """What may stand among the arguments of many tasks in its place: it is sent once, and workers fetch it from
        one another. The scheduler keeps what it needs to send it again when the worker that has it dies.
        """
        return self.client.submit(on_worker, __version__, _itself, (argument,), pure=False)

    def results(self, work: Callable[..., Any], tasks: Tasks, keep_errors: bool = False) -> Iterator[tuple[int, Any]]:
        """Number and result of every task as it is done, in any order; a task is the arguments of a call of `work`.

        Tasks are taken and sent as others are done, so that their number is not bounded by the scheduler's memory.
        Where `tasks` gives None, it is asked again when one is done. The first error of a task is raised, and what has
        not begun is called off; keep_errors: an `InputError` is its result.
        """
        from distributed import as_completed

        tasks, sent, done = iter(tasks), {}, as_completed(loop=self.client.loop)
        most, number = AHEAD * max(self.workers, 1), 0
        try:
            while True:
                while len(sent) < most and (arguments := next(tasks, None)) is not None:
                    future = self.client.submit(on_worker, __version__, work, arguments, pure=False)
                    sent[future], number = number, number + 1
                    done.add(future)
                if not sent:
                    return
                future = next(done)
                result = self._result(future, keep_errors)
                yield sent.pop(future), result
                del future, result  # the worker may forget it
        finally:
            if sent:
                self.client.cancel(list(sent))

    def _result(self, future: Any, keep_errors: bool) -> Any:
        try:
            return self._gathered(future)
        except InputError as error:
            if not keep_errors:
                raise
            return error

    def _gathered(self, future: Any) -> Any:
        from distributed import KilledWorker
        from distributed.client import FutureCancelledError

        try:
            return future.result()
        except KilledWorker as error:
            last, count = error.last_worker.address, error.allowed_failures + 1
            raise InputError(
                f"workers died of one task, {count} in all, the last at {last}: "
                f"it needs more memory than a worker has, give fewer workers or more memory to each"
            ) from error
        except FutureCancelledError as error:
            raise InputError("the scheduler is gone: start it and run this again") from error
        except ModuleNotFoundError as error:
            raise InputError(f"a worker lacks {error.name}: install hagoromo {__version__} on all workers") from error


def _itself(argument: Any) -> Any:
    return argument


def on_worker(version: str, work: Callable[..., Any], arguments: tuple[Any, ...]) -> Any:
    """Runs on a worker: `work` of `arguments`, if hagoromo is of `version` here."""
    check_version(version, __version__, "a worker")
    _set_threads()
    keep_fetched()
    return work(*arguments)


@contextmanager
def workers_of(scheduler: str | int) -> Iterator[Cluster]:
    """The workers of `scheduler`: the address of a running one, "local", or a number.

    Addresses are "tls://host:8786", whose certificate Dask's settings vouch for, or
    `TrustedScheduler("tcp://host:8786")`. A number of worker processes is started on this machine for the time of the
    block; "local": one a core. They share its cores and its free memory evenly, and nobody else reaches them.
    `InputError` for another address, one where no scheduler answers, or one without workers, with workers of another
    version, or with several threads a worker.
    """
    try:
        import cryptography  # noqa: F401 - by which Dask makes the keys of workers that are started here
        import distributed
    except ImportError as error:
        raise InputError(NO_DASK) from error
    from dask import config

    with config.set({LARGE_GRAPH: LARGEST_ARGUMENT}):
        if isinstance(scheduler, str) and "://" in scheduler:
            with connected(distributed, scheduler) as client:
                yield Cluster(client)
        else:
            with started(distributed, _count(str(scheduler))) as client:
                yield Cluster(client)


def _count(text: str) -> int:
    if text == "local":
        return cores()
    if not (text.isascii() and text.isdigit() and 1 <= int(text[:9]) <= MOST_WORKERS):
        raise InputError(
            f"scheduler is {shown(text)!r}: give a number of workers from 1 to {MOST_WORKERS}, local, or the address "
            f"of one that runs: {FORMS}"
        )
    return int(text)


def _set_threads() -> None:
    """As many threads of kernels as the worker's environment asks for."""
    stated = os.environ.get(THREADS, "")
    if stated:
        if not (stated.isdigit() and 1 <= int(stated) <= 1024):
            raise InputError(f"{THREADS} is {stated!r} on a worker: set it to a number of threads, or unset it")
        set_threads(int(stated))


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
