"""Beside: a part of the work in a process of its own, whose results are found in the cache afterwards.

Volume boxes of cloth are built, and kernels compiled, by hardly more than one core; two processes use two.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from multiprocessing import get_context, parent_process
from typing import Any

FEWEST_CORES = 2  # for a second process to save time


@contextmanager
def beside(work: Callable[..., object], *arguments: Any, wanted: bool = True) -> Iterator[Callable[[], None]]:
    """Run `work` in another process meanwhile; gives what waits for its end. Both are of a module, and can be pickled.

    A failure of the process costs time only: whoever needs its results makes them. It ends with this block and with
    this process. wanted: False, and a machine of one core: nothing runs.
    """
    if not wanted or (os.cpu_count() or 1) < FEWEST_CORES:
        yield lambda: None
        return
    process = get_context("spawn").Process(target=_alone, args=(work, arguments), daemon=True)
    try:
        process.start()
    except OSError:  # no more processes, or no memory for one
        yield lambda: None
        return
    try:
        yield process.join
    finally:
        process.terminate()
        process.join()


def _alone(work: Callable[..., object], arguments: tuple[Any, ...]) -> None:
    """In the other process: silent, and gone as soon as the first one is."""
    above = parent_process()
    if above is not None:
        threading.Thread(target=lambda: (above.join(), os._exit(1)), daemon=True).start()
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.dup2(nowhere, 2)
    with suppress(BaseException):  # whoever needs the results makes them
        work(*arguments)
