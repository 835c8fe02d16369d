"""Interrupt: Ctrl-C or a polite kill ends a verb, so that what it had begun to write is removed.

The signal raises `KeyboardInterrupt` wherever the verb is. Foreign code may swallow that, or make another error of it
(an import within a compiled module does): so it is remembered, and told again by the next error or step of progress.
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
        yield  # signals are heard in the main thread only
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
    """Raise `KeyboardInterrupt` if a signal was heard, in case the first was swallowed."""
    if _heard.is_set():
        raise KeyboardInterrupt


def _interrupt(*_: object) -> None:
    _heard.set()
    raise KeyboardInterrupt
