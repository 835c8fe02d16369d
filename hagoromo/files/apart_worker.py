"""The process apart: reads one file after the other, as `read_apart` asks, and answers with arrays or a message.

It ends when nobody can ask any more. A library's own failure (a signal, too much memory or time) ends it, too.
"""

from __future__ import annotations

import json
import os
import signal
import socket
import sys
import time
from contextlib import suppress
from functools import lru_cache, reduce
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from hagoromo.errors import InputError
from hagoromo.files.checks import ALLOWED
from hagoromo.files.memory import SHARE_OF_MEMORY, free_memory, is_shortage, shortage
from hagoromo.files.shared_arrays import HEADER, SHARED_FROM, bytes_of, give, layout_of, shared

MEMORY_HOLDS_S = 0.5  # how long what was free is taken to be free
LARGEST_IDLE = 1 << 29  # bytes of memory: what has more after a file is not kept


def serve() -> None:
    """Answer what is asked on standard input, on standard output; nothing else is read or written there.

    Arguments: the channel's file descriptor, or an empty text; modules to load meanwhile.
    """
    channel = socket.socket(fileno=int(sys.argv[2])) if sys.argv[2] else None
    asked, out = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    nowhere = os.open(os.devnull, os.O_RDWR)
    for stream in (0, 1, 2):
        os.dup2(nowhere, stream)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the process that asks: it ends this one
    for module in sys.argv[3:]:
        with suppress(ImportError):
            __import__(module)
    while len(head := asked.read(HEADER.size)) == HEADER.size:
        _answer(json.loads(asked.read(HEADER.unpack(head)[0])), out, channel)


def _answer(task: dict[str, Any], out: BinaryIO, channel: socket.socket | None) -> None:
    answer, held = _result(task, channel)
    text = json.dumps(answer | {"stays": _resident() < LARGEST_IDLE}).encode()
    out.write(HEADER.pack(len(text)) + text)
    if isinstance(held, bytearray):
        out.write(held)
    out.flush()
    if isinstance(held, int) and channel is not None:
        give(channel, held)


def _result(task: dict[str, Any], channel: socket.socket | None) -> tuple[dict[str, Any], bytearray | int | None]:
    """The answer, and its bytes or the descriptor of their memory."""
    module, name = task["read"]
    try:
        if task["folder"] is not None:
            os.chdir(task["folder"])
        os.environ.pop(ALLOWED, None)
        os.environ.update({} if task["allowed"] is None else {ALLOWED: task["allowed"]})
        _bound(task["seconds"])
        read: Any = reduce(getattr, name.split("."), __import__(module, fromlist=["_"]))
        arrays = {name: np.asarray(array) for name, array in read(Path(task["path"]), *task["given"]).items()}
        layout, size = layout_of(arrays)
        if channel is not None and size >= SHARED_FROM:
            return {"layout": layout, "size": size, "shared": True}, shared(layout, size, arrays)
        held = bytes_of(layout, size, arrays)
    except InputError as error:
        return {"error": str(error)}, None
    except Exception as error:
        if is_shortage(error):
            return {"error": f"{task['path']}: {shortage(error)}"}, None
        return {"fault": f"{type(error).__name__}: {error}"}, None
    return {"layout": layout, "size": size, "shared": False}, held


def _bound(seconds: float) -> None:
    """Give this process so much more time of computing, and no more memory than is free."""
    try:
        import resource
    except ImportError:  # of POSIX alone
        return
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    _, hard = resource.getrlimit(resource.RLIMIT_CPU)
    most = int(time.process_time() + seconds) + 1
    resource.setrlimit(resource.RLIMIT_CPU, (most if hard < 0 else min(most, hard), hard))
    _bound_memory(int(time.monotonic() / MEMORY_HOLDS_S))


@lru_cache(maxsize=1)
def _bound_memory(now: int) -> None:
    """Bound the addresses, on Linux: other systems do not heed it. now: of the clock; asking takes a millisecond."""
    import psutil

    if not Path("/proc/self").exists():
        return
    try:
        import resource
    except ImportError:
        return
    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (hard, hard))  # `free_memory` goes by the bound that is in force
    most = psutil.Process().memory_info().vms + int(SHARE_OF_MEMORY * free_memory())
    resource.setrlimit(resource.RLIMIT_AS, (most if hard < 0 else min(most, hard), hard))


def _resident() -> int:
    import psutil

    return psutil.Process().memory_info().rss
