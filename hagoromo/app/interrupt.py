"""Interrupt: Ctrl-C, SIGTERM or SIGHUP ends a command such that its unfinished output is removed.

The signal raises `KeyboardInterrupt`, but not everywhere. An exception that goes through compiled code which does not
expect it may end the process (a step of a Dr.Jit loop, a destructor) or come out as another one (an import), and one
that cuts off the removal of unfinished output leaves some. There the signal is noted, and raised again a moment later,
or by the next report of progress, or in place of the next error.
"""

from __future__ import annotations

import contextlib
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from hagoromo_start.stopping_signals import stopping_signals

STATUS_OF_SIGNALS = 128  # exit status of a process that a signal ended, without the number of the signal
AGAIN_S = 0.02  # between two attempts to raise
# where nothing may be raised: what compiled code calls, and what takes back unfinished output
COMPILED_STEPS = {"_loop_cond", "_loop_body", "_if_stmt_true", "_if_stmt_false", "__del__"}  # those of dr.syntax
CLOSED = ("drjit", "mitsuba", "importlib", "_frozen_importlib", "zarr", "asyncio", "filelock", "shutil", "tempfile")
CLOSED_FILES = ("whole", "leftovers", "resumable", "exchange")  # of hagoromo.files
_heard: list[int] = []  # signals that were received


@contextmanager
def signals_as_interrupt() -> Iterator[None]:
    """SIGINT, SIGTERM and SIGHUP raise `KeyboardInterrupt` while the block runs, as do later errors.

    SIGINT and SIGHUP stay ignored where they are, and those that another program deals with are left to it.
    """
    if threading.current_thread() is not threading.main_thread():
        yield  # signals arrive in the main thread only
        return
    _heard.clear()
    before = {number: signal.getsignal(number) for number in stopping_signals()}
    for number, handler in before.items():
        if number == signal.SIGTERM or handler in (signal.SIG_DFL, signal.default_int_handler) or _is_early(handler):
            signal.signal(number, _interrupt)
    try:
        yield
        heed()
    except Exception as error:
        if _heard:
            raise KeyboardInterrupt from error
        raise
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def heed() -> None:
    """Raise `KeyboardInterrupt` if a signal was received, in case the first exception was suppressed or put off."""
    if _heard and signal.getsignal(_heard[0]) is _interrupt:
        raise KeyboardInterrupt


def exit_status() -> int:
    """The exit status of a command that was interrupted: 128 and the number of the signal, 130 for Ctrl-C."""
    return STATUS_OF_SIGNALS + (_heard[0] if _heard else signal.SIGINT)


def wait_for_kernels() -> None:
    """Wait for the kernels that run: a process that ends meanwhile may be aborted."""
    if "drjit" in sys.modules:
        with contextlib.suppress(Exception):
            sys.modules["drjit"].sync_thread()


def _interrupt(number: int, frame: FrameType | None) -> None:
    _heard.append(number)
    if _may_raise(frame):
        raise KeyboardInterrupt
    again = threading.Timer(AGAIN_S, _raise_again, (number,))
    again.daemon = True
    again.start()


def _raise_again(number: int) -> None:
    """Send the signal once more, unless the command that it was meant for has ended: the next one has heard nothing."""
    if _heard and signal.getsignal(number) is _interrupt:
        signal.raise_signal(number)


def _may_raise(frame: FrameType | None) -> bool:
    """Whether an exception may be raised in a frame: none of those that called it is where nothing may be raised."""
    while frame is not None:
        module = str(frame.f_globals.get("__name__", ""))
        if frame.f_code.co_name in COMPILED_STEPS or module.partition(".")[0] in CLOSED:
            return False
        if module.startswith("hagoromo.files.") and module.rpartition(".")[2] in CLOSED_FILES:
            return False
        frame = frame.f_back
    return True


def _is_early(handler: object) -> bool:
    """Whether a handler is that of the entry of the command, which ends the process before anything is written."""
    return getattr(handler, "__module__", "").startswith("hagoromo_start")
