"""Which Dr.Jit backend computes: CUDA, Metal or LLVM, chosen once, when the first kernel needs it.

`HAGOROMO_BACKEND` (cuda, metal or llvm) overrides the choice. Nothing else in the package calls `mi.set_variant`.
"""

from __future__ import annotations

import importlib
import os
from functools import cache
from types import ModuleType
from typing import Any

from hagoromo.errors import InputError

BACKENDS = ("cuda", "metal", "llvm")
NO_LLVM = (
    "no Dr.Jit backend works here: no GPU was found and the library libLLVM is missing; "
    "install it (Debian/Ubuntu: apt-get install libllvm15, macOS: brew install llvm) or set DRJIT_LIBLLVM_PATH"
)


@cache
def name() -> str:
    """Name of the backend in use: the first of cuda, metal, llvm that works.

    Raises `InputError` when none works, or when `HAGOROMO_BACKEND` asks for one that does not.
    """
    asked = os.environ.get("HAGOROMO_BACKEND", "")
    if asked and asked not in BACKENDS:
        raise InputError(f"HAGOROMO_BACKEND is {asked!r}: set it to one of {', '.join(BACKENDS)}, or unset it")
    for backend in (asked,) if asked else BACKENDS:
        if _works(backend):
            return backend
    raise InputError(f"HAGOROMO_BACKEND={asked} does not work on this machine: unset it" if asked else NO_LLVM)


@cache
def arrays() -> ModuleType:
    """The Dr.Jit namespace of the backend in use (`Float`, `UInt`, `Array3f`, ...), with derivatives."""
    return importlib.import_module(f"drjit.{name()}.ad")


@cache
def mitsuba() -> ModuleType:
    """Mitsuba with the RGB variant that matches the backend set."""
    import mitsuba as mi

    mi.set_variant(f"{name()}_ad_rgb")
    return mi


def clip(value: Any, low: Any, high: Any) -> Any:
    """`value` held between `low` and `high`, for Python floats and Dr.Jit arrays.

    Kernels use this, `dr.fmin` and `dr.fmax` instead of `dr.clip`, `dr.minimum` and `dr.maximum`: those propagate NaN
    by an instruction that libLLVM before 17 cannot compile on x86, where the process aborts.
    """
    import drjit as dr

    return dr.fmin(dr.fmax(value, low), high)


def opaque_vector(values: Any) -> Any:
    """Three numbers as an Array3f that kernels read from memory: other numbers do not compile a new kernel."""
    import drjit as dr

    vector = arrays().Array3f(*(float(value) for value in values))
    dr.make_opaque(vector)
    return vector


def _works(backend: str) -> bool:
    import drjit as dr

    kind = getattr(dr.JitBackend, {"cuda": "CUDA", "metal": "Metal", "llvm": "LLVM"}[backend])
    return bool(dr.has_backend(kind))
