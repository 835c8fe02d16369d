"""How many kernels a piece of work compiles."""

from __future__ import annotations

from collections.abc import Callable

import drjit as dr


def compilations(work: Callable[[], object]) -> int:
    """Kernels that `work` compiles, or reads from the disk's cache of compiled ones."""
    dr.kernel_history_clear()
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory):
        work()
        history = dr.kernel_history()
    jit = [kernel for kernel in history if "cache_hit" in kernel]
    assert jit
    return sum(not kernel["cache_hit"] or kernel["cache_disk"] for kernel in jit)
