"""Library: a package that reads a format and is no part of the core; without it, one line says how to install it."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from hagoromo.errors import InputError

EXTRAS = {
    "nrrd": "volumes", "nibabel": "volumes", "h5py": "volumes", "vtkmodules": "vtk", "pxr": "usd",
    "lensfunpy": "lenses", "PyOpenColorIO": "display", "alembic3d": "alembic",
}  # fmt: skip


def library(name: str) -> Any:
    """The package `name` of an extra; `InputError` where it is not installed."""
    try:
        return import_module(name)
    except ImportError:
        extra = EXTRAS[name.split(".")[0]]
        raise InputError(f"this format needs {name.split('.')[0]}: pip install 'hagoromo[{extra}]'") from None
