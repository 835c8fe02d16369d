"""Cluster: Dask's workers, on this machine or on many, that run pure functions on small arguments.

`distributed` schedules, moves results, and runs again what a worker held that died. A function that is sent must give
the same bits wherever it runs and whenever: then nothing is lost with a worker. Every worker is one process with one
task at a time; Dr.Jit's threads use the cores inside it.
"""

from __future__ import annotations

import logging
import os
import pkgutil
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any, Protocol

from hagoromo.errors import InputError
from hagoromo.files.memory import free_memory
from hagoromo.files.names import reason
from hagoromo.files.stores import KEPT_MB, keep_fetched
from hagoromo.version import __version__

CONNECT_S = 10.0  # time in which a scheduler must answer, and have a worker
MOST_WORKERS = 256  # processes on this machine
SHARE_OF_MEMORY = 0.8  # of what is free now, for all workers of this machine together
SHARE_KEPT = 0.1  # of a worker's memory, for what it has fetched from a store
AHEAD = 4  # tasks a worker that wait on the scheduler; more only when these are done
DEATHS = 10  # workers that may die of a task before it is given up
NOWHERE_ELSE = "127.0.0.1:0"  # of the servers that tell of the state of workers: this machine, any free port
THREADS = "HAGOROMO_THREADS"  # environment of a worker: threads of its kernels
NO_DASK = "--scheduler needs Dask, which is not installed: install hagoromo[cluster]"
ALONE = {  # settings of Dask for workers that are started here
    "distributed.scheduler.allowed-failures": DEATHS,
    # a worker holds a scene as long as it lives: it would never go on once it was paused
    "distributed.worker.memory.target": False,
    "distributed.worker.memory.spill": False,
    "distributed.worker.memory.pause": False,
}
VERSION = (
    "hagoromo.version:__version__"  # asked for by a function of Python's own: a worker may have any version, or none
)


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


def on_worker(version: str, work: Callable[..., Any], arguments: tuple[Any, ...]) -> Any:
    """Runs on a worker: `work` of `arguments`, if hagoromo is of `version` here."""
    _check_version(version, __version__, "a worker")
    _set_threads()
    keep_fetched()
    return work(*arguments)


@contextmanager
def workers_of(scheduler: str | int) -> Iterator[Cluster]:
    """The workers of `scheduler`: the address of a running one ("tcp://host:8786"), "local", or a number.

    A number of worker processes is started on this machine for the time of the block; "local": one a core. They share
    its cores and its free memory evenly. `InputError` for an address where no scheduler answers, or one without
    workers, with workers of another version, or with several threads a worker.
    """
    try:
        import distributed
    except ImportError as error:
        raise InputError(NO_DASK) from error
    text = str(scheduler)
    if "://" in text:
        with _connected(distributed, text) as client:
            yield Cluster(client)
    else:
        with _started(distributed, _count(text)) as client:
            yield Cluster(client)


def _count(text: str) -> int:
    if text == "local":
        return cores()
    if not (text.isascii() and text.isdigit() and 1 <= int(text[:9]) <= MOST_WORKERS):
        raise InputError(
            f"scheduler is {text[:60]!r}: give the address of one (tcp://host:8786), local, or a number of workers "
            f"from 1 to {MOST_WORKERS}"
        )
    return int(text)


def cores() -> int:
    """Cores that this process may use."""
    if sys.platform == "linux":
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@contextmanager
def _connected(distributed: Any, address: str) -> Iterator[Any]:
    """A client of the running scheduler at `address`, whose workers are fit for tasks."""
    _quiet()
    try:
        client = distributed.Client(address, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError, TypeError, ImportError) as error:
        raise InputError(
            f"no Dask scheduler answers at {address} within {CONNECT_S:g} s: start one ({reason(error)})"
        ) from error
    try:
        _check_workers(distributed, client, address)
        yield client
    finally:
        client.close(timeout=CONNECT_S)


def _check_workers(distributed: Any, client: Any, address: str) -> None:
    try:
        client.wait_for_workers(1, timeout=CONNECT_S)
    except (TimeoutError, distributed.TimeoutError) as error:
        raise InputError(f"the scheduler at {address} has no worker: start one with `dask worker {address}`") from error
    for name, facts in client.scheduler_info(n_workers=-1)["workers"].items():
        if facts["nthreads"] != 1:
            raise InputError(
                f"worker {name} runs {facts['nthreads']} tasks at a time: start it with --nthreads 1, and its kernels' "
                f"threads with {THREADS}={facts['nthreads']}"
            )
    for name, version in client.run(pkgutil.resolve_name, VERSION, on_error="return").items():
        _check_version(__version__, version if isinstance(version, str) else "none", f"worker {name}")


def _check_version(wanted: str, version: str, worker: str) -> None:
    if version != wanted:
        raise InputError(f"{worker} has hagoromo {version}, the client {wanted}: install {wanted} on all workers")


@contextmanager
def _started(distributed: Any, count: int) -> Iterator[Any]:
    """A client of `count` worker processes of this machine, which end with the block."""
    from dask import config

    _quiet()
    memory = int(SHARE_OF_MEMORY * free_memory() / count)
    environment = {THREADS: str(max(cores() // count, 1)), KEPT_MB: str(int(SHARE_KEPT * memory / 1e6))}
    with (
        config.set(ALONE),
        distributed.LocalCluster(
            n_workers=count, threads_per_worker=1, processes=True, host="127.0.0.1", dashboard_address=NOWHERE_ELSE,
            worker_dashboard_address=NOWHERE_ELSE, scheduler_kwargs={"dashboard": False}, memory_limit=memory,
            silence_logs=logging.CRITICAL, env=environment,
        ) as cluster,
        distributed.Client(cluster, set_as_default=False) as client,
    ):  # fmt: skip
        yield client


def _quiet() -> None:
    """What Dask logs of workers that come and go is no message for people who asked for a picture."""
    for name in ("distributed", "distributed.client", "distributed.nanny", "distributed.scheduler", "tornado"):
        logging.getLogger(name).setLevel(logging.CRITICAL)


def _set_threads() -> None:
    """As many threads of kernels as the worker's environment asks for."""
    stated = os.environ.get(THREADS, "")
    if stated:
        import drjit as dr

        if not (stated.isdigit() and 1 <= int(stated) <= 1024):
            raise InputError(f"{THREADS} is {stated!r} on a worker: set it to a number of threads, or unset it")
        if dr.thread_count() != int(stated):
            dr.set_thread_count(int(stated))
