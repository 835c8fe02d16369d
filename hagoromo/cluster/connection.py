"""Connection: a Dask client of a scheduler that runs, or of worker processes that are started here.

Whoever reaches a scheduler or a worker of Dask may run programs there. What is started here listens on loopback alone,
speaks TLS by a key that it has made for itself and keeps in memory, and serves no page: no other user of the machine
gets in.
"""

from __future__ import annotations

import logging
import os
import pkgutil
import socket
import ssl
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from hagoromo.cluster.scheduler_address import SchedulerAddress, scheduler_address
from hagoromo.errors import InputError
from hagoromo.files.memory import free_memory
from hagoromo.files.names import reason
from hagoromo.files.stores import KEPT_MB
from hagoromo.version import __version__

CONNECT_S = 10.0  # time in which a scheduler must answer, and have a worker
AGAIN_S = 0.2  # after which a port that nobody listens to is tried again
SHARE_OF_MEMORY = 0.8  # of what is free now, for all workers of this machine together
SHARE_KEPT = 0.1  # of a worker's memory, for what it has fetched from a store
DEATHS = 10  # workers that may die of a task before it is given up
NOWHERE_ELSE = "127.0.0.1:0"  # of the servers that tell of the state of workers: this machine, any free port
THREADS = "HAGOROMO_THREADS"  # environment of a worker: threads of its kernels
LOUD = ("distributed", "distributed.client", "distributed.nanny", "distributed.scheduler", "tornado")
ALONE = {  # settings of Dask for workers that are started here
    "distributed.scheduler.allowed-failures": DEATHS,
    # a worker holds a scene as long as it lives: it would never go on once it was paused
    "distributed.worker.memory.target": False,
    "distributed.worker.memory.spill": False,
    "distributed.worker.memory.pause": False,
    # pages without TLS that tell everybody on this machine what is computed
    "distributed.scheduler.http.routes": [],
    "distributed.worker.http.routes": [],
}
VERSION = (
    "hagoromo.version:__version__"  # asked for by a function of Python's own: a worker may have any version, or none
)


def cores() -> int:
    """Cores that this process may use."""
    if sys.platform == "linux":
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@contextmanager
def connected(distributed: Any, text: str) -> Iterator[Any]:
    """A client of the running scheduler at the address `text`, whose workers are fit for tasks."""
    address = scheduler_address(text)
    security = address.security(distributed)
    _quiet()
    try:
        _knock(address, security)
        client = _client(distributed, address, security)
    except InputError:
        raise
    except Exception as error:  # of what is no scheduler, whatever it answers
        raise InputError(
            f"no Dask scheduler answers at {address.text} within {CONNECT_S:g} s: start one ({reason(error)})"
        ) from error
    try:
        _check_workers(distributed, client, address.text)
        yield client
    finally:
        with suppress(OSError, TimeoutError):
            client.close(timeout=CONNECT_S)


def _knock(address: SchedulerAddress, security: Any) -> None:
    """Wait until somebody answers there and, of tls://, has shown a certificate that is trusted.

    A scheduler speaks first. Dask itself would wait for one that does not, for ever.
    """
    end = time.monotonic() + CONNECT_S
    while True:
        try:
            with _opened(address, security) as opened:
                if not opened.recv(1):
                    raise ConnectionError("it closes the connection")
                return
        except ssl.SSLError as error:
            raise InputError(
                f"the certificates of {address.text} and those of Dask's settings here do not belong together: give "
                f"all machines certificates of one authority ({reason(error)})"
            ) from error
        except ConnectionRefusedError:
            if time.monotonic() + AGAIN_S > end:
                raise
            time.sleep(AGAIN_S)


@contextmanager
def _opened(address: SchedulerAddress, security: Any) -> Iterator[socket.socket]:
    """A connection to what listens there."""
    with socket.create_connection((address.host, address.port), timeout=CONNECT_S) as plain:
        if not address.encrypted:
            yield plain
            return
        context = security.get_connection_args("client")["ssl_context"]
        with context.wrap_socket(plain, server_hostname=address.host) as encrypted:
            yield encrypted


def _client(distributed: Any, address: SchedulerAddress, security: Any) -> Any:
    """A connected client. One that does not get so far is closed: it would end in a traceback when it is forgotten."""
    client = distributed.Client.__new__(distributed.Client)
    try:
        client.__init__(address.text, timeout=CONNECT_S, set_as_default=False, security=security)
    except BaseException:
        with suppress(Exception):
            client.close(timeout=1.0)
        client.status = "closed"
        raise
    return client


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
        check_version(__version__, version if isinstance(version, str) else "none", f"worker {name}")


def check_version(wanted: str, version: str, worker: str) -> None:
    """`InputError` where `worker` has another version of this package than the one that is `wanted`."""
    if version != wanted:
        raise InputError(f"{worker} has hagoromo {version}, the client {wanted}: install {wanted} on all workers")


@contextmanager
def started(distributed: Any, count: int) -> Iterator[Any]:
    """A client of `count` worker processes of this machine, which end with the block."""
    from dask import config

    _quiet()
    memory = int(SHARE_OF_MEMORY * free_memory() / count)
    environment = {THREADS: str(max(cores() // count, 1)), KEPT_MB: str(int(SHARE_KEPT * memory / 1e6))}
    with config.set(ALONE):
        try:
            cluster = distributed.LocalCluster(
                n_workers=count, threads_per_worker=1, processes=True, host="127.0.0.1", dashboard_address=NOWHERE_ELSE,
                worker_dashboard_address=NOWHERE_ELSE, scheduler_kwargs={"dashboard": False}, memory_limit=memory,
                silence_logs=logging.CRITICAL, env=environment, security=distributed.Security.temporary(),
            )  # fmt: skip
        except Exception as error:
            raise InputError(
                f"{count} worker processes did not start: {reason(error.__cause__ or error)}; one was killed, or there "
                "is no room for it: give fewer workers, or run without --scheduler"
            ) from error
        with cluster, distributed.Client(cluster, set_as_default=False) as client:
            yield client


def _quiet() -> None:
    """What Dask logs of workers that come and go is no message for people who asked for a picture."""
    for name in LOUD:
        logging.getLogger(name).setLevel(logging.CRITICAL)
