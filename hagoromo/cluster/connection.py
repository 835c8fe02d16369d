"""Connection: a Dask client of a scheduler that runs, or of worker processes that are started here.

Whoever reaches a scheduler or a worker of Dask may run programs there. What is started here listens on loopback alone,
speaks TLS by a key that it has made for itself and keeps in memory, and serves no page: no other user of the machine
gets in.

The address of a Dask scheduler: which forms are taken, and what each of them needs.

A client of Dask unpickles what its scheduler sends, which may be a program. So the other end must be one's own. tls://
proves it: the scheduler shows a certificate that those of Dask's settings vouch for. tcp:// proves nothing; it is taken
only where the user says that he trusts whoever answers (`TrustedScheduler`, --trust-scheduler).
"""

from __future__ import annotations

import logging
import os
import pkgutil
import re
import socket
import ssl
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any, NamedTuple

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
NOWHERE_ELSE = "127.0.0.1:0"  # of the servers that show the state of workers: this machine, any free port
THREADS = "HAGOROMO_THREADS"  # environment of a worker: threads of its kernels
LOUD = ("distributed", "distributed.client", "distributed.nanny", "distributed.scheduler", "tornado")
ALONE = {  # settings of Dask for workers that are started here
    "distributed.scheduler.allowed-failures": DEATHS,
    # a worker holds a scene as long as it lives: it would never go on once it was paused
    "distributed.worker.memory.target": False,
    "distributed.worker.memory.spill": False,
    "distributed.worker.memory.pause": False,
    # pages without TLS that show everybody on this machine what is computed
    "distributed.scheduler.http.routes": [],
    "distributed.worker.http.routes": [],
}
VERSION = (
    "hagoromo.version:__version__"  # asked for by a function of Python's own: a worker may have any version, or none
)
ADDRESS = re.compile(r"(tcp|tls)://([\w.-]+|\[[0-9A-Fa-f:.]+(?:%\w+)?\]):(\d{1,5})/?", re.ASCII)
LARGEST_PORT = 2**16 - 1
FORMS = "tls://host:8786, or tcp://host:8786 with --trust-scheduler"
CERTIFICATES = "distributed.comm.tls.ca-file, .client.cert and .client.key"


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


class TrustedScheduler(str):
    """The address of a scheduler whose every answer may run code on this machine: `TrustedScheduler("tcp://host:8786")`.

    Only where nobody else can answer at that address, or read what passes.
    """

    __slots__ = ()


class SchedulerAddress(NamedTuple):
    """An address that may be connected to. text: as Dask takes it."""

    text: str
    host: str
    port: int

    @property
    def encrypted(self) -> bool:
        """Whether both ends prove by certificates who they are."""
        return self.text.startswith("tls:")

    def security(self, distributed: Any) -> Any:
        """Dask's `Security` of a client: with the certificates of Dask's settings, which tls:// needs."""
        if not self.encrypted:
            return distributed.Security(require_encryption=False)
        security = distributed.Security(require_encryption=True)
        try:
            context = security.get_connection_args("client")["ssl_context"]
        except (OSError, ValueError) as error:  # of ssl, too
            raise InputError(
                f"{self.text} needs certificates, and those of Dask's settings ({CERTIFICATES}) cannot be read: "
                f"{reason(error)}"
            ) from error
        if context is None:
            raise InputError(
                f"{self.text} needs certificates: make some and name them in Dask's settings ({CERTIFICATES}), "
                "as docs/cluster.md says"
            )
        return security


def shown(text: str) -> str:
    """The text of an address as messages repeat it: without user, password and all that may be a secret."""
    scheme, mark, rest = text.rpartition("://")
    return f"{scheme}{mark}{re.split('[?#]', rest.rpartition('@')[2])[0]}"[:80]


def scheduler_address(text: str) -> SchedulerAddress:
    """The address that may be connected to; `InputError` for another form, and for tcp:// that nobody trusts."""
    found = ADDRESS.fullmatch(text)
    if found is None or not 0 < int(found[3]) <= LARGEST_PORT:
        wrong = "holds a user or a password, which Dask does not take" if "@" in text else "is of another form"
        raise InputError(f"the address of the scheduler, {shown(text)!r}, {wrong}: give {FORMS}")
    address = SchedulerAddress(text.rstrip("/"), found[2].strip("[]"), int(found[3]))
    if not (address.encrypted or isinstance(text, TrustedScheduler)):
        raise InputError(
            f"whoever answers at {text} can run programs on this machine: give a tls:// address, whose certificate is "
            "checked, or add --trust-scheduler (in Python: hg.TrustedScheduler) where only you can answer there"
        )
    return address
