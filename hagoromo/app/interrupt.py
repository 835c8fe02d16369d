"""Interrupt: Ctrl-C (SIGINT) or SIGTERM ends a command such that its unfinished output is removed.

The signal raises `KeyboardInterrupt`. Other code may suppress it or turn it into another error (imports in compiled
modules do). So the signal is recorded, and the next error or progress report raises `KeyboardInterrupt` again.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

_heard = threading.Event()


@contextmanager
def signals_as_interrupt() -> Iterator[None]:
    """SIGTERM, and SIGINT unless it is ignored, raise `KeyboardInterrupt` while the block runs, as do later errors."""
    if threading.current_thread() is not threading.main_thread():
        yield  # signals arrive in the main thread only
        return
    _heard.clear()
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    for number, handler in before.items():
        if number == signal.SIGTERM or handler is signal.default_int_handler:
            signal.signal(number, _interrupt)
    try:
        yield
    except Exception as error:
        if _heard.is_set():
            raise KeyboardInterrupt from error
        raise
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        _heard.clear()


def heed() -> None:
    """Raise `KeyboardInterrupt` if a signal was received, in case the first exception was suppressed."""
    if _heard.is_set():
        raise KeyboardInterrupt


def _interrupt(*_: object) -> None:
    _heard.set()
    raise KeyboardInterrupt
