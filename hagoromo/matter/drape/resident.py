"""Resident: what `dr.freeze` asks for. An array that shares NumPy's memory must not be freed while it records a call:
the process would abort. So what is recorded reads copies, and what the collector may free waits until it is done.
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
    """`dr.freeze` of `step`, with Python's collector still during calls: its litter may hold arrays of anybody."""
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
