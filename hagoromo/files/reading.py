"""Reading: what a library raises about a damaged file becomes one line that names the file.

Silence: libraries that parse a file print nothing about its damage, which the exception that follows says.

Only the libraries' own logs are closed. The process's standard error is never redirected: other threads, and notebooks,
print to it meanwhile.
"""

from __future__ import annotations

import logging
import warnings
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from contextvars import ContextVar
from importlib import import_module
from pathlib import Path
from typing import Any

from hagoromo.errors import InputError
from hagoromo.files.memory import is_shortage, shortage
from hagoromo.files.names import reason

EXTRAS = {
    "nrrd": "volumes", "nibabel": "volumes", "h5py": "volumes", "vtkmodules": "vtk", "pxr": "usd",
    "lensfunpy": "lenses", "PyOpenColorIO": "display", "alembic3d": "alembic",
    "pycolmap": "views",
}  # fmt: skip
_closed: ContextVar[bool] = ContextVar("_closed", default=False)


@contextmanager
def reading(path: str | Path, what: str) -> Iterator[None]:
    """Turn any exception of the block but `InputError` into one: libraries raise what comes to them at damaged bytes.

    what: what the file is read as, such as "TIFF". Only calls of a library and the use of what it gave belong in the
    block. Warnings of the library about the file are not shown.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except InputError:
        raise
    except Exception as error:
        if is_shortage(error):
            raise InputError(f"{path}: {shortage(error)}") from error
        raise InputError(f"{path} cannot be read as {what}, it may be cut off or damaged: {reason(error)}") from error


def library(name: str) -> Any:
    """The package `name` of an extra; `InputError` where it is not installed."""
    try:
        return import_module(name)
    except ImportError:
        extra = EXTRAS[name.split(".")[0]]
        raise InputError(f"this needs {name.split('.')[0]}: pip install 'hagoromo[{extra}]'") from None


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
