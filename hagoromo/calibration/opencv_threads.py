"""OpenCV with one thread, for results that repeat."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def one_thread() -> Iterator[None]:
    """OpenCV with one thread inside this block.

    Several threads add in any order, and each has random numbers of its own: the same call gives other digits, or
    another outcome, from run to run.
    """
    import cv2

    count = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(count)
