"""Resident arrays for `dr.freeze`: an array that shares NumPy's memory must not be freed while a call is recorded.

Dr.Jit aborts the process in that case. So a recorded function reads copies, and Python's garbage collector is paused
until the recording ends.
"""

from __future__ import annotations

import gc
from collections.abc import Callable
from typing import Any

import drjit as dr

from hagoromo.backend import arrays, lookup


def resident(kind: Any, values: Any) -> Any:
    """A flat Dr.Jit array of `kind`, a copy of `values` in memory of Dr.Jit's own, which may be freed at any time."""
    shared = lookup(kind, values)
    copy = dr.gather(kind, shared, dr.arange(arrays().UInt, dr.width(shared)))
    dr.eval(copy)
    dr.sync_thread()
    return copy


def frozen(step: Callable[..., Any]) -> Callable[..., Any]:
    """`dr.freeze` of `step`, with Python's garbage collector paused during calls: it may free arrays of other code."""
    recorded = dr.freeze(step)

    def call(*values: Any) -> Any:
        was_on = gc.isenabled()
        gc.disable()
        try:
            return recorded(*values)
        finally:
            if was_on:
                gc.enable()

    return call
