"""Apart: a C library that decodes a file from outside does it in a process of its own, which it may crash or fill.

The process may take no more memory than is free (Linux) and no more time than its file is worth, and prints nothing. It
waits for the next file when it is done: the first file of a command costs the start of a process, a quarter of a
second, the next ones a fraction of a millisecond each.
"""

from __future__ import annotations

import atexit
import json
import logging
import os
import signal
import socket
import struct
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.checks import ALLOWED
from hagoromo.files.memory import require
from hagoromo.files.shared_arrays import HEADER, arrays_of_layout, memory_of

Arrays = dict[str, NDArray[Any]]
SECONDS = 20.0  # of computing, that any file may take
SECONDS_PER_BYTE, SECONDS_PER_STATED = 2e-6, 1e-7  # more for each byte of it, and for each that it unpacks to
WAITED = 10.0  # seconds by the clock for one of computing: a machine may have much else to do
MOST_IDLE = 2  # processes that wait for the next file
LARGEST_ANSWER = 1 << 28  # bytes of what the process says besides the arrays
START = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]); from hagoromo.files.apart_worker import serve; serve()"
)


class Helper(NamedTuple):
    """process: decodes one file after the other. channel: over which it gives the memory of large arrays, or None.

    owner: the process that started it. path: where it finds modules.
    """

    process: subprocess.Popen[bytes]
    channel: socket.socket | None
    owner: int
    path: str

    def end(self) -> None:
        """End the process, whatever it does."""
        self.process.kill()
        self.process.wait()
        for stream in (self.process.stdin, self.process.stdout, self.channel):
            with suppress(OSError):
                if stream is not None:
                    stream.close()


_idle: list[Helper] = []
_lock = threading.Lock()


def read_apart(
    read: Callable[..., Mapping[str, NDArray[Any]]], path: str | Path, what: str, *given: Any, stated: float = 0.0
) -> Arrays:
    """The arrays that `read(path, *given)`, a function of a module, returns; it runs in another process.

    what: what the file is read as, for messages. given: plain data. stated: bytes that the file unpacks to, where that
    is known. `InputError` where `read` raises one, and where the process dies, or computes for too long.
    """
    path, seconds = Path(path), SECONDS + SECONDS_PER_STATED * stated
    logging.getLogger(__name__).debug("reading %s as %s in a process of its own", path, what)
    with suppress(OSError):
        seconds += SECONDS_PER_BYTE * path.stat().st_size
    task = {
        "read": [read.__module__, read.__qualname__], "path": str(path), "given": given, "seconds": seconds,
        "folder": _working_folder(), "allowed": os.environ.get(ALLOWED),
    }  # fmt: skip
    helper = _taken()
    try:
        answer, arrays = _asked(helper, json.dumps(task).encode(), seconds)
    except InputError:
        helper.end()
        raise
    except (OSError, EOFError, ValueError, KeyError, TypeError, struct.error) as error:
        helper.end()
        raise InputError(f"{path} cannot be read as {what}: {_end_of(helper.process.returncode, seconds)}") from error
    except BaseException:
        helper.end()
        raise
    _give_back(helper, bool(answer.get("stays")))
    if "error" in answer:
        raise InputError(str(answer["error"]))
    if "fault" in answer:
        raise RuntimeError(f"{task['read']} of {path}: {answer['fault']}")
    return arrays


def prepare(*modules: str) -> None:
    """Start a process that waits, unless there is one, and have it load modules, while this one does something else."""
    with _lock:
        if any(each.owner == os.getpid() for each in _idle):
            return
    _give_back(_started(json.dumps(sys.path), modules), True)


def _asked(helper: Helper, task: bytes, seconds: float) -> tuple[dict[str, Any], Arrays]:
    """What the process answers, and the arrays; any of several exceptions where it dies, or what it says is wrong."""
    to, back = helper.process.stdin, helper.process.stdout
    assert to is not None and back is not None
    watch = threading.Timer(WAITED * seconds, helper.process.kill)
    watch.daemon = True
    watch.start()
    try:
        to.write(HEADER.pack(len(task)) + task)
        to.flush()
        answer = json.loads(_bytes_from(back, HEADER.unpack(_bytes_from(back, HEADER.size))[0]))
        size = int(answer.get("size", 0))
        if size and answer["shared"]:
            assert helper.channel is not None
            held: Any = memory_of(helper.channel, size)
        else:
            require(size, "what is in it")
            held = bytearray(size)
            _fill(back, held)
    finally:
        watch.cancel()
    return answer, arrays_of_layout(answer.get("layout", []), held)


def _bytes_from(stream: Any, size: int) -> bytes:
    if size > LARGEST_ANSWER:
        raise ValueError("the answer is too long")
    data = bytearray(size)
    _fill(stream, data)
    return bytes(data)


def _fill(stream: Any, data: bytearray) -> None:
    view, filled = memoryview(data), 0
    while filled < len(data):
        count = stream.readinto(view[filled:])
        if not count:
            raise EOFError
        filled += count


def _taken() -> Helper:
    """A process that waits, or a new one; one that was inherited by a fork is left to its owner."""
    places = json.dumps(sys.path)
    with _lock:
        _idle[:] = [each for each in _idle if each.owner == os.getpid()]
        while _idle:
            helper = _idle.pop()
            if helper.path == places and helper.process.poll() is None:
                return helper
            helper.end()
    return _started(places)


def _started(places: str, modules: Sequence[str] = ()) -> Helper:
    ours, theirs = socket.socketpair() if hasattr(os, "memfd_create") else (None, None)
    number = [] if theirs is None else [theirs.fileno()]
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    process = subprocess.Popen(
        [sys.executable, "-c", START, places, str(number[0]) if number else "", *modules],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, pass_fds=number, env=environment,
    )  # fmt: skip
    if theirs is not None:
        theirs.close()
    return Helper(process, ours, os.getpid(), places)


def _give_back(helper: Helper, stays: bool) -> None:
    with _lock:
        if stays and len(_idle) < MOST_IDLE:
            _idle.append(helper)
            return
    helper.end()


def _end_of(status: int | None, seconds: float) -> str:
    """Why the process died."""
    if status is not None and status in (-getattr(signal, "SIGXCPU", 0), -getattr(signal, "SIGKILL", 9)):
        return f"that takes more than {seconds:.3g} s of computing, or more memory than is free: it may be damaged"
    return "the library that reads it has crashed: copy it again"


def _working_folder() -> str | None:
    try:
        return os.getcwd()
    except OSError:
        return None  # it was removed


@atexit.register
def _end_all() -> None:
    with _lock:
        for helper in _idle:
            if helper.owner == os.getpid():
                helper.end()
        _idle.clear()
