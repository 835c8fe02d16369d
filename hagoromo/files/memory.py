"""Memory: what this process may still take, asked before anything is allocated whose size comes from a file.

The least of what the machine has free, what its control group leaves (a container, a job of a cluster) and what the
limits of the process leave (`ulimit -v`, `ulimit -d`).
"""

from __future__ import annotations

import ctypes
import math
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from hagoromo.errors import InputError
from hagoromo.files.names import printable

SHARE_OF_MEMORY = 0.9  # largest share of the free memory for one array; the rest is left for work on it
UNLIMITED = 1 << 60  # a limit above this is none: version 1 of control groups writes the largest number of pages
GROUPS = Path("/sys/fs/cgroup")
OWN_GROUPS = Path("/proc/self/cgroup")
# version 2 and 1: limit, usage, and the line of memory.stat with the files in memory, which the kernel drops on demand
FILES_OF_GROUP = (
    ("memory.max", "memory.current", "inactive_file"),
    ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"),
)
# what libraries write who report a lack of memory by another exception than MemoryError
SIGNS_OF_SHORTAGE = (
    "out of memory", "insufficient memory", "cannot allocate memory", "failed to map segment", "bad_alloc",
    "can't start new thread", "unable to allocate", "could not allocate",
)  # fmt: skip
GPU_SHORTAGE = "(backend=CUDA, shared=0)"  # in Dr.Jit's message: not memory of the host


def require(size: float, what: str) -> None:
    """Raise `InputError` if `what`, which needs `size` bytes, does not fit into the free memory.

    Called before the memory is allocated.
    """
    free = free_memory()
    size = math.inf if isinstance(size, int) and size > UNLIMITED else float(size)  # too large a whole number for one
    if not size <= SHARE_OF_MEMORY * free:
        raise InputError(
            f"{what} needs {size / 2**30:.3g} GiB of memory and {free / 2**30:.3g} GiB are free: make it smaller"
        )


def free_memory() -> int:
    """Memory that this process may still take [bytes]."""
    import psutil

    left = [psutil.virtual_memory().available, *_left_by_groups(), *_left_by_limits()]
    return max(int(min(left)), 0)


def return_unused() -> None:
    """Return memory that nothing uses to the system: what Dr.Jit keeps for arrays to come, and, with the C library of
    GNU, what is free between others. After many arrays of some megabytes the latter may be as much as is in use.
    """
    import drjit as dr

    dr.flush_malloc_cache()
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None) if sys.platform == "linux" else None
    if trim is not None:
        trim(0)


def is_shortage(error: BaseException) -> bool:
    """Whether an exception says that memory could not be had; libraries have several kinds for it."""
    return isinstance(error, MemoryError) or any(sign in str(error).lower() for sign in SIGNS_OF_SHORTAGE)


def shortage(error: BaseException) -> str:
    """The line for a lack of memory that was noticed only when it was taken."""
    said = printable(error)[:120]
    if GPU_SHORTAGE in str(error):
        return f"the memory of the GPU is not enough ({said}): make the input smaller, or set HAGOROMO_BACKEND=llvm"
    return (
        f"the memory is not enough, {free_memory() / 2**30:.3g} GiB are free{f' ({said})' if said else ''}: "
        f"make the input smaller, or allow the program more memory"
    )


def _left_by_limits() -> Iterator[int]:
    """Memory that the limits of the process leave (address space, data); none are given if the system has no limits."""
    import psutil

    system: Any = psutil
    process: Any = psutil.Process()
    if not hasattr(process, "rlimit"):
        return  # macOS does not heed them, Windows has none
    used = process.memory_info()
    for limit, taken in ((system.RLIMIT_AS, used.vms), (system.RLIMIT_DATA, getattr(used, "data", 0))):
        soft = process.rlimit(limit)[0]
        if 0 <= soft < UNLIMITED:
            yield soft - taken


def _left_by_groups() -> Iterator[int]:
    """Memory that each control group of the process, and those above it, leave."""
    for folder in _groups():
        for limit, usage, files in FILES_OF_GROUP:
            most, used = _number(folder / limit), _number(folder / usage)
            if most is not None and used is not None and most < UNLIMITED:
                yield most - used + _stat(folder / "memory.stat", files)


def _groups() -> Iterator[Path]:
    """Folders of the control groups that limit the memory of this process."""
    try:
        lines = OWN_GROUPS.read_text(encoding="ascii", errors="replace").splitlines()
    except OSError:
        return  # no Linux
    for line in lines:
        number, controllers, path = [*line.split(":", 2), "", ""][:3]
        if number != "0" and "memory" not in controllers.split(","):
            continue
        top = GROUPS if number == "0" else GROUPS / "memory"
        own = top / path.lstrip("/")
        inner = own if own.is_dir() else top  # within a container the path may be that outside it
        yield from (folder for folder in (inner, *inner.parents) if folder == top or top in folder.parents)


def _number(path: Path) -> int | None:
    """The number in a file of a control group; None where it is absent or says max."""
    try:
        text = path.read_text(encoding="ascii", errors="replace").strip()
    except OSError:
        return None
    return int(text) if text.isdigit() else None


def _stat(path: Path, name: str) -> int:
    """A line of memory.stat [bytes]; 0 where it is absent."""
    try:
        lines = path.read_text(encoding="ascii", errors="replace").splitlines()
    except OSError:
        return 0
    found = [line.split()[1] for line in lines if line.startswith(f"{name} ")]
    return int(found[0]) if found and found[0].isdigit() else 0
