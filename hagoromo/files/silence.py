"""Silence: libraries that parse a file print nothing about its damage, which the exception that follows says.

Only the libraries' own logs are closed. The process's standard error is never redirected: other threads, and notebooks,
print to it meanwhile.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from contextvars import ContextVar

_closed: ContextVar[bool] = ContextVar("_closed", default=False)


class _Opened(logging.Filter):
    """Lets records through unless their thread is within `tifffile_silenced` or `trimesh_silenced`."""

    def filter(self, record: logging.LogRecord) -> bool:
        return not _closed.get()


@contextmanager
def _silenced(*logs: str) -> Iterator[None]:
    for log in map(logging.getLogger, logs):
        if not any(isinstance(one, _Opened) for one in log.filters):
            log.addFilter(_Opened())
    before = _closed.set(True)
    try:
        yield
    finally:
        _closed.reset(before)


def tifffile_silenced() -> AbstractContextManager[None]:
    """tifffile logs nothing in this thread while the block runs."""
    return _silenced("tifffile")


def trimesh_silenced() -> AbstractContextManager[None]:
    """trimesh logs nothing in this thread while the block runs."""
    return _silenced("trimesh.util", "trimesh.triangles")


def nibabel_silenced() -> AbstractContextManager[None]:
    """nibabel logs nothing in this thread while the block runs."""
    return _silenced("nibabel.global")


@contextmanager
def opencv_silenced() -> Iterator[None]:
    """OpenCV logs nothing while the block runs, in no thread: its level is one for the process."""
    import cv2

    level = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        yield
    finally:
        cv2.utils.logging.setLogLevel(level)
