"""Backend of Dr.Jit: CUDA, Metal or LLVM, chosen once when the first kernel needs it; and arrays in memory.

`HAGOROMO_BACKEND` (cuda, metal or llvm) overrides the choice. Nothing else in the package calls `mi.set_variant`.
"""

from __future__ import annotations

import importlib
import logging
import os
import platform
from collections.abc import Mapping
from functools import cache
from types import ModuleType
from typing import Any, TypeAlias

from hagoromo.errors import InputError

# Dr.Jit's arrays in signatures of kernels: one entry per ray. The backend, and with it the type, is chosen at run time
# (`arrays`), so the type checker takes them for Any. Functions of physics take a Python float where Float stands, too.
Float: TypeAlias = Any  # single precision
Bool: TypeAlias = Any
Int: TypeAlias = Any  # 32 bits
Int64: TypeAlias = Any
UInt: TypeAlias = Any  # 32 bits
Array3f: TypeAlias = Any  # vector or point: x, y, z
Array3u: TypeAlias = Any
Array4f: TypeAlias = Any
Array4u: TypeAlias = Any

X86 = ("x86_64", "AMD64", "i386", "i686")
BACKENDS = ("cuda", "metal", "llvm")
LEAST_THREADS = 2  # of kernels: one alone is Python's own, which does not take numbers below 1e-38 for 0
ALIGNMENT = 64  # bytes, of Dr.Jit's own memory: the widest vector of 16 floats
MOST_ENTRIES = 2**32 - 1  # largest number of entries of an array, whose indices have 32 bits
OLDEST_LLVM = 17  # oldest version on x86: with older ones, kernels with a maximum or arctan2 abort (Dr.Jit 1.5)
NO_OPTIX = (
    "Mitsuba cannot trace surfaces on this GPU, as OptiX does not start: install libnvoptix.so.1 of NVIDIA's driver "
    "(in a container: NVIDIA_DRIVER_CAPABILITIES=compute,graphics,utility), or set HAGOROMO_BACKEND=llvm"
)
NO_LLVM = (
    "no Dr.Jit backend works here: no GPU was found and the library libLLVM {state}; "
    "install it (Debian/Ubuntu: apt-get install libllvm19, macOS: brew install llvm, Windows: LLVM's installer) "
    "or set DRJIT_LIBLLVM_PATH"
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
            logging.getLogger(__name__).info("kernels run on %s", backend)
            return backend
    if asked not in ("", "llvm"):
        raise InputError(f"HAGOROMO_BACKEND={asked} does not work on this machine: unset it")
    version = _llvm_version()
    raise InputError(NO_LLVM.format(state=f"is too old ({version} of {OLDEST_LLVM})" if version else "is missing"))


@cache
def arrays() -> ModuleType:
    """The Dr.Jit namespace of the backend in use (`Float`, `UInt`, `Array3f`, ...), with derivatives."""
    if name() == "llvm":
        import drjit as dr

        set_threads(dr.thread_count())
    return importlib.import_module(f"drjit.{name()}.ad")


def set_threads(count: int) -> None:
    """Have kernels of the CPU run in `count` threads, at least LEAST_THREADS: their bits are then the same."""
    import drjit as dr

    if dr.thread_count() != max(count, LEAST_THREADS):
        dr.set_thread_count(max(count, LEAST_THREADS))


def mitsuba() -> ModuleType:
    """Mitsuba with the RGB variant that matches the backend set, also where other code has set another one since."""
    import mitsuba as mi

    variant = f"{name()}_ad_rgb"
    if mi.variant() != variant:
        mi.set_variant(variant)
    return mi


def traced_scene(shapes: Mapping[str, Any]) -> Any:
    """Mitsuba's scene of some shapes, by name. `InputError` where the GPU's library of ray tracing is missing.

    OptiX traces rays of one scene in a kernel: `dr.eval` the hits of one before rays of another are traced.
    """
    try:
        return mitsuba().load_dict({"type": "scene", **shapes})
    except RuntimeError as error:
        if "OptiX" in str(error):
            raise InputError(NO_OPTIX) from error
        raise


def clip(value: Any, low: Any, high: Any) -> Any:
    """`value` limited to the range from `low` to `high`, for Python floats and Dr.Jit arrays.

    Kernels use this, `dr.fmin` and `dr.fmax` instead of `dr.clip`, `dr.minimum` and `dr.maximum`, which need extra
    instructions to propagate NaN.
    """
    import drjit as dr

    return dr.fmin(dr.fmax(value, low), high)


def evaluate(*values: Any) -> None:
    """Have values computed now, in a kernel of their own, as `dr.eval` does: that leaves named tuples out."""
    import drjit as dr

    def arrays_of(value: Any) -> Any:
        return [arrays_of(each) for each in value] if isinstance(value, (tuple, list)) else value

    dr.eval(arrays_of(values))


def recorded_once() -> Any:
    """A context in which Dr.Jit records the body of a loop once, and does not do so anew to take out of its state what
    the loop leaves as it is: a kernel is traced in half the time, a loop within a loop in a quarter.
    """
    import drjit as dr

    return dr.scoped_set_flag(dr.JitFlag.OptimizeLoops, False)


def opaque_vector(values: Any) -> Any:
    """Three numbers as an Array3f that kernels read from memory, so that other numbers do not need a new kernel."""
    import drjit as dr

    vector = arrays().Array3f(*(float(value) for value in values))
    dr.make_opaque(vector)
    return vector


def check_entries(count: int, what: str) -> None:
    """Raise `InputError` if `what` needs an array with more entries than 32-bit indices can address."""
    if count > MOST_ENTRIES:
        raise InputError(f"{what} need {count:.3g} numbers and an array holds {MOST_ENTRIES:.3g}: make it smaller")


def lookup(kind: Any, values: Any) -> Any:
    """A NumPy array as a flat Dr.Jit array of type `kind` for kernels; other values do not need a new kernel.

    Dr.Jit shares the memory of NumPy arrays, compiles different code where it is not aligned as Dr.Jit's own, and takes
    an array of one entry for a constant. So the values are copied to aligned memory, and a single entry is doubled.
    """
    import numpy as np

    flat = np.asarray(values).ravel()
    return column(kind, np.repeat(flat, 2) if flat.size == 1 else flat)


def column(kind: Any, values: Any) -> Any:
    """A NumPy array as a flat Dr.Jit array of type `kind`, an entry for each lane; other values need no new kernel.

    As in `lookup`, Dr.Jit does not share the memory of `values`, whose alignment differs from run to run: kernels would
    be compiled anew by chance.
    """
    import drjit as dr
    import numpy as np

    flat = np.asarray(values).ravel()
    memory = aligned(flat.size, flat.dtype)
    memory[:] = flat
    array = kind(memory)
    if flat.size == 1:
        dr.make_opaque(array)  # Dr.Jit takes it for a constant
    return array


def vectors(points: Any) -> Any:
    """A NumPy array (n, 3) as an Array3f, a row for each lane: see `column`."""
    import numpy as np

    kind = arrays()
    return kind.Array3f(*(column(kind.Float, np.asarray(each, np.float32)) for each in np.moveaxis(points, 1, 0)))


def aligned(count: int, kind: Any) -> Any:
    """An uninitialised NumPy array (count,) of type `kind`, aligned so that Dr.Jit can share its memory."""
    import numpy as np

    kind = np.dtype(kind)
    memory = np.empty(count * kind.itemsize + ALIGNMENT, np.uint8)
    first = -memory.ctypes.data % ALIGNMENT
    return memory[first : first + count * kind.itemsize].view(kind)


def _works(backend: str) -> bool:
    import drjit as dr

    kind = getattr(dr.JitBackend, {"cuda": "CUDA", "metal": "Metal", "llvm": "LLVM"}[backend])
    if not dr.has_backend(kind):
        return False
    return backend != "llvm" or platform.machine() not in X86 or _llvm_version() >= OLDEST_LLVM


def _llvm_version() -> int:
    """Major version of the libLLVM that Dr.Jit found; 0 without one."""
    import drjit as dr
    import drjit.detail

    return int(drjit.detail.llvm_version()[0]) if dr.has_backend(dr.JitBackend.LLVM) else 0
